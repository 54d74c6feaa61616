"""Every learned method by its name: GEM, its rivals (Sec. 4.1), and their ablations (Table A2)."""

from __future__ import annotations

import dataclasses

from gem_lite.config import ABLATIONS, LITE, Config
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.cliport import ClipPort, GroundedClipPort
from gem_lite.policies.gem import Policy
from gem_lite.policies.transporter import TransporterLan

METHODS: dict[str, type[PickPlacePolicy]] = {
    method.method: method for method in (Policy, TransporterLan, ClipPort, GroundedClipPort)
}
ABLATED = {
    f"{method}-{ending}": ablation.meaning
    for method in METHODS
    for ending, ablation in ABLATIONS.items()
    if method in ablation.methods
}
"""What a name with one ending means."""
NAMES = (*METHODS, *ABLATED)
"""Methods, and methods with one ending; a name may have several endings."""
HELP = "methods:\n" + "\n".join(
    f"  {name:48s}{meaning}"
    for name, meaning in {
        "gem": "the paper's method",
        "transporter-lan": "Transporter Networks with language",
        "cliport": "a semantic stream from CLIP beside a spatial one",
        "cliport-grounded": "the same, told where CLIP finds the words: stronger than the paper's",
        **ABLATED,
    }.items()
)
"""The end of a command line's help."""


def split(name: str) -> tuple[str, tuple[str, ...]]:
    """A name without its endings, and the endings in the order of `ABLATIONS`; the name may have them in any order.

    Raises:
        ValueError: no such method, or an ending that is unknown or changes nothing of the method.
    """
    allowed = f"method must be one of {', '.join(NAMES)}, or have several of a method's endings, got {name!r}"
    methods = [method for method in METHODS if name == method or name.startswith(f"{method}-")]
    if not methods:
        raise ValueError(allowed)
    method = max(methods, key=len)
    endings = set()
    rest = name.removeprefix(method)
    while rest:
        matching = [e for e, a in ABLATIONS.items() if method in a.methods and f"{rest}-".startswith(f"-{e}-")]
        if not matching:
            raise ValueError(allowed)
        ending = max(matching, key=len)
        endings.add(ending)
        rest = rest.removeprefix(f"-{ending}")
    return method, tuple(ending for ending in ABLATIONS if ending in endings)


def find(name: str, config: Config) -> tuple[type[PickPlacePolicy], Config]:
    """The class of a method's name, and ``config`` with what the name switches off.

    Raises:
        ValueError: no such method, or endings that contradict each other.
    """
    method, endings = split(name)
    for ending in endings:
        config = config.ablated(ending)
    return METHODS[method], config


def of_card(card: dict) -> tuple[type[PickPlacePolicy], Config]:
    """The class and the configuration of a checkpoint's card; the method's name in it names the ablations.

    Raises:
        ValueError: an unknown method, or a configuration that is not the method's.
    """
    try:
        method, ablations = split(card["method"])
    except ValueError as error:
        raise ValueError(f"unknown method {card['method']!r}: {error}") from error
    # Cards that were written before configurations held their ablations have them in the method's name alone.
    return METHODS[method], dataclasses.replace(Config.from_dict(card["config"]), ablations=ablations)


def canonical(name: str) -> str:
    """The name as checkpoints and results hold it: with its endings in the order of `ABLATIONS`.

    Raises:
        ValueError: see `find`.
    """
    method, config = find(name, LITE)
    return method.method + config.variant
