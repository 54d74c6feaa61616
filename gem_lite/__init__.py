"""gem_lite: Grounded Equivariant Manipulation, small enough to read and good enough to train.

Import it before torch: it sets how torch's threads wait. The environment's own ``OMP_WAIT_POLICY`` counts more.
"""

import os

# Between two pieces of work OpenMP's threads spin: two programs then take each other's cores and hardly move on.
# Passive threads sleep. OpenMP reads this once, when torch is loaded; child processes inherit it.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
