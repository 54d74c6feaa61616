"""The paper's real tables (A.11) in simulation: their size, and the size of what lies on them.

The paper's workspace is 29 cm x 21 cm. Its height map has 320 x 240 cells of 0.906 mm, and so covers 29 cm x 21.75 cm.
Here, the map is padded to whole multiples of 16 cells, in `lite` of 1.81 mm: the table is 29 cm x 23.2 cm, and things
lie on the 29 cm x 21 cm in its middle.
"""

from __future__ import annotations

from gem_lite.se2 import Workspace

SCALE = 0.5
"""Things are half as large as CLIPort's: objects are up to 5.5 cm long. The paper does not say their sizes."""
PIXEL = 0.29 / 160
"""The size (m) of a cell in `lite`."""
AREA = Workspace(0.395, 0.605, -0.145, 0.145, pixel=PIXEL)
"""Where things are laid out: 29 cm (y) x 21 cm (x), in the middle of the default workspace."""
WORKSPACE = Workspace.covering(AREA.x_min, AREA.x_max, AREA.y_min, AREA.y_max, pixel=PIXEL)
"""The table: `AREA` with a border at both ends of x, 160 x 128 cells."""
GAP = 0.0075
"""Free space (m) around every body."""
