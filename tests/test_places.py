import numpy as np

from gem_lite.maps.places import Place, best_places
from gem_lite.policies.gem_config import LITE


def test_the_best_places_are_plateaus_apart_from_each_other_the_highest_first():
    semantic = np.zeros(LITE.workspace.shape, np.float32)
    semantic[40:45, 20:25] = 0.9
    semantic[100:103, 60:63] = 0.61234
    seen = np.ones(semantic.shape, bool)
    found = best_places(semantic, seen, LITE)
    centres = [LITE.workspace.to_world(*centre) for centre in ((42, 22), (101, 61))]
    named = [
        (round(float(x), 4), round(float(y), 4), score) for (x, y), score in zip(centres, (0.9, 0.612), strict=True)
    ]
    assert found == [Place(*values) for values in named]
    assert best_places(semantic, seen, LITE, count=1) == found[:1]
    assert best_places(np.zeros_like(semantic), seen, LITE) == []
    seen[38:48, 18:28] = False
    assert best_places(semantic, seen, LITE)[0] == found[1], "nothing is pointed at where no camera saw"
