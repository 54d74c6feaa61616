"""Tables of named entries, such as tasks and methods. A program outside the library can add its own entries.

An entry is known after the import of the module that registers it. A new process (evaluation starts one for each core)
knows only the entries of the library. It therefore gets the names from `modules` and imports them with `load`.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

T = TypeVar("T")
_ALL: list[Registry] = []


class Registry(Generic[T]):
    """Entries of one kind by their names, in the order of registration.

    Args:
        kind: the name of the kind in error messages, such as "task".
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._entries: dict[str, T] = {}
        self._modules: dict[str, str] = {}
        _ALL.append(self)

    def add(self, name: str, entry: T, module: str | None = None) -> T:
        """Register an entry and return it.

        Args:
            name: the entry's name. If a module registers a name again (a notebook's cell that is run twice), the
                new entry replaces the old one.
            entry: usually a class or a function. It is not called here.
            module: the name of the module whose import registers the entry; by default the module that defines it.

        Raises:
            ValueError: the name is empty, or another module has registered it.
        """
        if not name:
            raise ValueError(f"name must not be empty: it identifies the {self.kind}")
        if module is None:
            module = str(getattr(entry, "__module__", type(entry).__module__))
        owner = self._modules.get(name, module)
        if owner != module:
            raise ValueError(f"name must be new: {owner} has registered the {self.kind} {name!r} already")
        self._entries[name] = entry
        self._modules[name] = module
        return entry

    def register(self, name: str) -> Callable[[T], T]:
        """`add` as a decorator: ``@TOOLS.register("hook")`` before a class."""
        return lambda entry: self.add(name, entry)

    def find(self, name: str) -> T:
        """The entry with this name. If there is none, raises ValueError with the nearest names."""
        if name not in self._entries:
            nearest = difflib.get_close_matches(name, self.names(), n=3, cutoff=0.3)
            if not nearest:
                nearest = list(self.names())
            raise ValueError(f"no {self.kind} is named {name!r}; the nearest names: {', '.join(nearest)}")
        return self._entries[name]

    def names(self) -> tuple[str, ...]:
        """All names, in the order of registration."""
        return tuple(self._entries)

    def modules(self) -> tuple[str, ...]:
        """The modules whose import registers all entries, each once."""
        return tuple(dict.fromkeys(self._modules.values()))


def modules() -> tuple[str, ...]:
    """The modules whose import registers all entries of all kinds that this process knows, for `load`."""
    return tuple(dict.fromkeys(module for registry in _ALL for module in registry.modules()))


def load(names: Iterable[str]) -> None:
    """Import modules, so that their entries are known. A new process imports the `modules` of its parent process.

    Entries of the main script need no import: a new process first runs the definitions of that script.

    Raises:
        ModuleNotFoundError: no module has one of these names.
    """
    for name in names:
        if name != "__main__":
            importlib.import_module(name)
