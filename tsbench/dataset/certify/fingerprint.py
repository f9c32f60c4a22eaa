"""Digest of the code that drives and judges a proof. It says who made a certificate, not whether it holds."""

from __future__ import annotations

from functools import cache

from tsbench.core.provenance import closure, digest, versions
from tsbench.run.contract import code_files

# Who drives a proof, the blind baselines and the experts, and who says what it proves.
_ROOTS = (
    "tsbench.planners.styles",
    "tsbench.planners.experts.expert",
    "tsbench.planners.idm",
    "tsbench.dataset.certify.certifier",
)


@cache
def driving_fingerprint() -> str:
    """SHA-256 (hex) over the episode's code, the planners', the certifier's, and versions."""
    files = code_files()
    return digest({"code": files | closure(_ROOTS, files), "versions": versions()})
