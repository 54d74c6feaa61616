"""Every learned method by its name: GEM, its rivals (Sec. 4.1), and their ablations (Table A2)."""

from __future__ import annotations

import inspect

from gem_lite.config import Config
from gem_lite.policies.base import METHODS, Policy


def meanings() -> dict[str, str]:
    """The meaning of every method, alone and with one ending, by its name; a name may have several endings."""
    plain = {name: (inspect.getdoc(METHODS.find(name)) or "").partition("\n")[0] for name in METHODS.names()}
    ablated = {
        f"{name}-{ending}": ablation.meaning
        for name in METHODS.names()
        for ending, ablation in METHODS.find(name).Config.ABLATIONS.items()
    }
    return plain | ablated


def split(name: str) -> tuple[str, tuple[str, ...]]:
    """A name without its endings, and the endings in the order of the method's `Config.ABLATIONS`.

    Args:
        name: with endings in any order.

    Raises:
        ValueError: no such method, or an ending that is unknown or changes nothing of the method.
    """
    allowed = f"method must be one of {', '.join(meanings())}, or have several of a method's endings, got {name!r}"
    methods = [method for method in METHODS.names() if name == method or name.startswith(f"{method}-")]
    if not methods:
        raise ValueError(allowed)
    method = max(methods, key=len)
    known = METHODS.find(method).Config.ABLATIONS
    endings = set()
    rest = name.removeprefix(method)
    while rest:
        matching = [ending for ending in known if f"{rest}-".startswith(f"-{ending}-")]
        if not matching:
            raise ValueError(allowed)
        ending = max(matching, key=len)
        endings.add(ending)
        rest = rest.removeprefix(f"-{ending}")
    return method, tuple(ending for ending in known if ending in endings)


def find(name: str, preset: str = "lite") -> tuple[type[Policy], Config]:
    """The class of a method's name, and one of its presets changed by the name's endings.

    Raises:
        ValueError: no such method or preset, or endings that contradict each other.
    """
    method_name, endings = split(name)
    method = METHODS.find(method_name)
    config = method.Config.preset(preset)
    for ending in endings:
        config = config.ablated(ending)
    return method, config


def of_card(card: dict) -> tuple[type[Policy], Config]:
    """The class and the configuration of a checkpoint's card.

    Raises:
        ValueError: an unknown method, or a configuration that is not the method's.
    """
    try:
        method_name, endings = split(card["method"])
    except ValueError as error:
        raise ValueError(f"unknown method {card['method']!r}: {error}") from error
    method = METHODS.find(method_name)
    config = method.Config.from_dict(card["config"])
    if config.ablations != endings:
        raise ValueError(
            f"its method {card['method']!r} and the ablations of its configuration, "
            f"{', '.join(config.ablations) or 'none'}, are not the same"
        )
    return method, config


def trained(name: str) -> str:
    """The method whose checkpoint can act as ``name``: without the endings that change rules of acting alone.

    Raises:
        ValueError: see `find`.
    """
    method, config = find(name)
    kept = [ending for ending in config.ablations if not acts_alone(config, ending)]
    return "-".join([method.method, *kept])


def acts_alone(config: Config, ending: str) -> bool:
    """Whether an ending changes rules of acting alone (`Config.ACTING`), so that a trained policy can take it."""
    changes = set(config.ablation(ending).changes)
    return bool(changes) and changes <= config.ACTING


def acting_as(card: dict, name: str) -> tuple[type[Policy], Config]:
    """As `of_card`, with the configuration by which a checkpoint acts as the method ``name``.

    Raises:
        ValueError: see `of_card`; the checkpoint holds another method, and differs by more than rules of acting.
    """
    method, config = of_card(card)
    wanted_method, endings = split(name)
    missing = [ending for ending in endings if ending not in config.ablations]
    same = (wanted_method, set(config.ablations) <= set(endings)) == (method.method, True)
    if not same or not all(acts_alone(config, ending) for ending in missing):
        raise ValueError(f"the checkpoint holds {method.method}{config.variant}, not {canonical(name)}")
    for ending in missing:
        config = config.ablated(ending)
    return method, config


def canonical(name: str) -> str:
    """The name as checkpoints and results hold it: with its endings in the order of the method's `Config.ABLATIONS`.

    Raises:
        ValueError: see `find`.
    """
    method, config = find(name)
    return method.method + config.variant
