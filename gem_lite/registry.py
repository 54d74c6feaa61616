"""Tables of named things, such as tasks and methods, to which a program outside the library can add its own.

A thing is known once the module that registers it is imported. A process that is started anew (evaluation starts one
a core) knows only what the library registers, so it is given `modules` and imports them with `load`.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

T = TypeVar("T")
_ALL: list[Registry] = []


class Registry(Generic[T]):
    """Things of one kind by their names, in the order of registration.

    Args:
        kind: what one of the things is called in errors, such as "task".
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._things: dict[str, T] = {}
        self._modules: dict[str, str] = {}
        _ALL.append(self)

    def add(self, name: str, thing: T, module: str | None = None) -> T:
        """Register a thing, and return it.

        Args:
            name: how it is asked for. A module that registers a name again (a notebook's cell that is run twice)
                replaces its own thing.
            thing: usually a class or a function; it is not called here.
            module: the name of the module whose import registers the thing: its own unless given.

        Raises:
            ValueError: the name is empty, or another module has registered it.
        """
        if not name:
            raise ValueError(f"name must not be empty: a {self.kind} is asked for by its name")
        module = module or getattr(thing, "__module__", type(thing).__module__)
        owner = self._modules.get(name, module)
        if owner != module:
            raise ValueError(f"name must be new: {owner} has registered the {self.kind} {name!r} already")
        self._things[name] = thing
        self._modules[name] = module
        return thing

    def register(self, name: str) -> Callable[[T], T]:
        """`add` as a decorator: ``@TOOLS.register("hook")`` before a class."""
        return lambda thing: self.add(name, thing)

    def find(self, name: str) -> T:
        """The thing with a name. Raises ValueError with the nearest names if there is none."""
        if name not in self._things:
            near = difflib.get_close_matches(name, self.names(), n=3, cutoff=0.3) or self.names()
            raise ValueError(f"no {self.kind} is named {name!r}; the nearest names: {', '.join(near)}")
        return self._things[name]

    def names(self) -> tuple[str, ...]:
        """All names, in the order of registration."""
        return tuple(self._things)

    def modules(self) -> tuple[str, ...]:
        """The modules whose import registers all that is here, each once."""
        return tuple(dict.fromkeys(self._modules.values()))


def modules() -> tuple[str, ...]:
    """The modules whose import registers all that this process knows, of every kind: see `load`."""
    return tuple(dict.fromkeys(module for registry in _ALL for module in registry.modules()))


def load(names: Iterable[str]) -> None:
    """Import modules, so that what they register is known: in a new process, those that `modules` gave in the old one.

    What was registered by a script itself needs no import: a new process runs the script's definitions first.

    Raises:
        ModuleNotFoundError: there is no module with such a name.
    """
    for name in names:
        if name != "__main__":
            importlib.import_module(name)
