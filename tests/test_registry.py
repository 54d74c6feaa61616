"""Tables of named things."""

import multiprocessing
import sys

import pytest

from gem_lite.foundations import registry
from gem_lite.foundations.registry import Registry

TOOL = """
from gem_lite.foundations.registry import Registry

TOOLS = Registry("tool")


@TOOLS.register("hook")
class Hook:
    pass
"""


@pytest.fixture
def fruits(monkeypatch):
    monkeypatch.setattr(registry, "_ALL", [])
    made = Registry("fruit")
    made.add("apple", str.upper, module="orchard")
    made.add("pear", str.lower, module="orchard")
    return made


def test_things_are_found_by_their_names_in_order(fruits):
    @fruits.register("plum")
    class Plum:
        pass

    assert fruits.names() == ("apple", "pear", "plum")
    assert fruits.find("pear") is str.lower and fruits.find("plum") is Plum
    assert fruits.modules() == ("orchard", __name__)


def test_an_unknown_name_names_the_nearest(fruits):
    with pytest.raises(ValueError, match="no fruit is named 'aple'; the nearest names: apple"):
        fruits.find("aple")
    with pytest.raises(ValueError, match="no fruit is named ''; the nearest names: apple, pear"):
        fruits.find("")


def test_a_name_belongs_to_the_module_that_registered_it(fruits):
    fruits.add("pear", str.title, module="orchard")  # as a cell that is run again
    assert fruits.find("pear") is str.title
    with pytest.raises(ValueError, match="orchard has registered the fruit 'pear'"):
        fruits.add("pear", str.title, module="garden")
    with pytest.raises(ValueError, match="must not be empty"):
        fruits.add("", str.title)


def test_modules_are_those_of_every_registry(fruits):
    other = Registry("tool")
    other.add("hook", "a value", module="orchard")
    other.add("hoe", "a value", module="shed")
    assert registry.modules() == ("orchard", "shed")


def known_tools(modules):
    registry.load(modules)
    return sys.modules["outside_tools"].TOOLS.names()


def test_a_new_process_learns_what_an_outside_module_registers(tmp_path, monkeypatch):
    (tmp_path / "outside_tools.py").write_text(TOOL)
    monkeypatch.syspath_prepend(tmp_path)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(known_tools, (("outside_tools", "__main__"),)) == ("hook",)


def test_a_module_that_is_gone_is_named():
    with pytest.raises(ModuleNotFoundError, match="no_such_module_at_all"):
        registry.load(["no_such_module_at_all"])
