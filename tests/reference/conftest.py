"""Makes the scalar step, which is several modules beside the tests, and the benchmark's scenes importable."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path += [str(folder) for folder in (HERE, HERE.parent / "bench") if str(folder) not in sys.path]
