"""Derive every seed of a study from its own, so that the same study gives the same runs anywhere."""

import hashlib
from dataclasses import dataclass

from gtf_tune.pipelines.run import RunKind

_BITS_31 = 2**31 - 1
_BITS_63 = 2**63 - 1


@dataclass(frozen=True)
class SeedSource:
    """Derive the seeds of one purpose of a study.

    ``purpose`` separates the search from its confirmation: runs of different purposes never share noise.
    """

    study_seed: int
    purpose: str = "search"

    def run_seed(self, fingerprint: str, kind: RunKind, index: int, number: int | None = None) -> int:
        """Return the pipeline's seed for run ``index`` of a sequence; 31 bits.

        ``number`` is the trial's, where trials must not share noise, else ``None``.
        """
        return _hash(self.study_seed, self.purpose, "run", fingerprint, kind, index, number) & _BITS_31

    def noise_seed(self, fingerprint: str, index: int, number: int | None = None) -> int:
        """Return the seed of the noise of noisy run ``index``; 63 bits."""
        return _hash(self.study_seed, self.purpose, "noise", fingerprint, index, number) & _BITS_63

    def sampler_seed(self, number: int) -> int:
        """Return the sampler's seed for one trial; 31 bits. An interruption before it changes nothing."""
        return _hash(self.study_seed, "sampler", number) & _BITS_31


def _hash(*parts: object) -> int:
    text = "\x1f".join(repr(part) for part in parts)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")
