"""What is measured. Experiments and lessons import what they share by one name: it lies in notebooks/."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "notebooks"))
