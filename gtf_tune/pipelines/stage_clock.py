"""Time the stages of one run."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field


@dataclass
class StageClock:
    """Measure the seconds that each stage took itself, by the clock ``now``, without the stages that it waited for."""

    seconds: dict[str, float] = field(default_factory=dict)
    now: Callable[[], float] = time.perf_counter
    _waited_s: list[float] = field(default_factory=list)

    @contextlib.contextmanager
    def timing(self, stage: str) -> Iterator[None]:
        """Add the time until the context ends to the stage."""
        started = self.now()
        self._waited_s.append(0.0)
        try:
            yield
        finally:
            elapsed = self.now() - started
            own = elapsed - self._waited_s.pop()
            self.seconds[stage] = self.seconds.get(stage, 0.0) + own
            if self._waited_s:
                self._waited_s[-1] += elapsed

    def diagnostics(self, stages: Sequence[str], always_run: Sequence[str]) -> dict[str, bool | float]:
        """Return ``STAGE_s`` for each stage, and ``STAGE_cached`` where a stage may have been at hand already."""
        cached = {f"{stage}_cached": stage not in self.seconds for stage in stages}
        seconds = {f"{stage}_s": round(self.seconds.get(stage, 0.0), 4) for stage in (*stages, *always_run)}
        return {**seconds, **cached}
