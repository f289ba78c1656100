"""Base class of all sections of a study definition."""

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """Section that refuses unknown keys and cannot change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, allow_inf_nan=False)
