"""Every learned method by its name: GEM, its ablations (Table A2) and its rivals (Sec. 4.1)."""

from __future__ import annotations

from gem_lite.baselines.cliport import ClipPort
from gem_lite.baselines.transporter import TransporterLan
from gem_lite.config import ABLATIONS, Config
from gem_lite.gem import Policy
from gem_lite.policy import PickPlacePolicy

METHODS: dict[str, type[PickPlacePolicy]] = {method.method: method for method in (Policy, TransporterLan, ClipPort)}
CLIPORT_WITHOUT_RECOLORING = f"{ClipPort.method}-without-recoloring"
NAMES = (*METHODS, *(f"{Policy.method}-{ending}" for ending in ABLATIONS), CLIPORT_WITHOUT_RECOLORING)
HELP = "methods:\n" + "\n".join(
    f"  {name:34s}{meaning}"
    for name, meaning in {
        "gem": "the paper's method",
        "transporter-lan": "Transporter Networks with language",
        "cliport": "a semantic stream from CLIP beside a spatial one",
        **{f"gem-{ending}": ablation.meaning for ending, ablation in ABLATIONS.items()},
        CLIPORT_WITHOUT_RECOLORING: "CLIPort with the paper's augmentation alone",
    }.items()
)
"""The end of a command line's help."""


def find(name: str, config: Config) -> tuple[type[PickPlacePolicy], Config]:
    """The class of a method's name, and ``config`` with what the name switches off.

    Raises:
        ValueError: no such method.
    """
    if name not in NAMES:
        raise ValueError(f"method must be one of {', '.join(NAMES)}, got {name!r}")
    method = next(method for method in METHODS if name == method or name.startswith(f"{method}-"))
    ending = name.removeprefix(method).removeprefix("-")
    return METHODS[method], config.ablated(ending) if ending else config
