"""How the tests compare and protect arrays; and a mark: in both simulators."""

import numpy as np
import pytest

BOTH = pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
equal = np.testing.assert_array_equal


def close(got, want, hint="", atol=1e-9, rtol=1e-7):
    """Arrays are alike; else numpy says after the hint where they are not."""
    np.testing.assert_allclose(got, want, rtol, atol, err_msg=hint)


def frozen(*arrays):
    """From now on nobody may write to these arrays."""
    for array in arrays:
        array.flags.writeable = False
