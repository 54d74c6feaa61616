"""Two other ways to propose regions. The source "regions" had the best peaks on validation scenes."""

from __future__ import annotations

import numpy as np
from typing_extensions import override

from gem_lite.maps.regions import Regions
from gem_lite.maps.sources import SOURCES
from gem_lite.maps.things import things
from gem_lite.planning.naming import whole_things
from gem_lite.rgbd.heightmap import HeightMap


@SOURCES.register("regions-that-rise")
class RegionsThatRise(Regions):
    """Only what rises above the table is a region."""

    @override
    def propose(self, heightmap: HeightMap) -> list[np.ndarray]:
        rising, _ = things(heightmap)
        return rising


@SOURCES.register("regions-of-whole-things")
class RegionsOfWholeThings(Regions):
    """A flat part belongs to the thing that rises beside it."""

    @override
    def propose(self, heightmap: HeightMap) -> list[np.ndarray]:
        return whole_things(heightmap)
