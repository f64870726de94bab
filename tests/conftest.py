"""Lets the tests import the stages: import_module("04_ppo")."""

import os
import sys
from pathlib import Path

os.environ["MPLBACKEND"] = "Agg"  # draw into files, without a screen
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
