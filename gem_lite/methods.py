"""Every learned method by its name: GEM, its ablations (Table A2) and its rivals (Sec. 4.1)."""

from __future__ import annotations

from gem_lite.baselines.cliport import ClipPort, GroundedClipPort
from gem_lite.baselines.transporter import TransporterLan
from gem_lite.config import ABLATIONS, Config
from gem_lite.gem import Policy
from gem_lite.policy import PickPlacePolicy

METHODS: dict[str, type[PickPlacePolicy]] = {
    method.method: method for method in (Policy, TransporterLan, ClipPort, GroundedClipPort)
}
CLIPORTS_WITHOUT_RECOLORING = tuple(f"{one.method}-without-recoloring" for one in (ClipPort, GroundedClipPort))
NAMES = (*METHODS, *(f"{Policy.method}-{ending}" for ending in ABLATIONS), *CLIPORTS_WITHOUT_RECOLORING)
HELP = "methods:\n" + "\n".join(
    f"  {name:38s}{meaning}"
    for name, meaning in {
        "gem": "the paper's method",
        "transporter-lan": "Transporter Networks with language",
        "cliport": "a semantic stream from CLIP beside a spatial one",
        "cliport-grounded": "the same, told where CLIP finds the words: stronger than the paper's",
        **{f"gem-{ending}": ablation.meaning for ending, ablation in ABLATIONS.items()},
        **{name: "the paper's augmentation alone" for name in CLIPORTS_WITHOUT_RECOLORING},
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
    method = max((method for method in METHODS if name == method or name.startswith(f"{method}-")), key=len)
    ending = name.removeprefix(method).removeprefix("-")
    return METHODS[method], config.ablated(ending) if ending else config
