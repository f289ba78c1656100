"""Hold the settings that every part of a study definition shares."""

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """Refuse unknown keys and changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, allow_inf_nan=False)
