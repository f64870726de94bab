"""What tests of several stages need: how arrays are compared, a mark, a file that is in use."""

import os
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

BOTH = pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
IN_3D_SLOW = pytest.mark.parametrize(
    "sim", ["pymunk", pytest.param("mujoco", marks=pytest.mark.slow)]
)
equal = np.testing.assert_array_equal


def close(got, want, hint="", atol=1e-9, rtol=1e-7):
    """Arrays are alike; else numpy says after the hint where they are not."""
    np.testing.assert_allclose(got, want, rtol, atol, err_msg=hint)


def frozen(*arrays):
    """From now on nobody may write to these arrays."""
    for array in arrays:
        array.flags.writeable = False


def locked(name):
    """A context in which another program, as on Windows, keeps the file of this name open when it is
    replaced."""
    replace = os.replace

    def held(source, target):
        if Path(target).name == name:
            raise PermissionError(13, "Access is denied")
        replace(source, target)

    return mock.patch("os.replace", held)
