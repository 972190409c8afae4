import os

# Nothing in the default tests renders; has to be said before MuJoCo is imported.
os.environ.setdefault("MUJOCO_GL", "disable")

import numpy as np
import pytest
from hypothesis import settings

from tablesetting.scene.scene import Scene

# Machines are noisy; the same examples every time.
settings.register_profile("tests", deadline=None, derandomize=True)
settings.load_profile("tests")

VASE_LAYOUT = np.array([[0.2, 0.3], [0.7, 0.7], [0.2, 0.75], [0.75, 0.25]])
SPOON_LAYOUT = np.array(
    [[0.2, 0.8], [0.75, 0.7], [0.7, 0.1], [0.1, 0.1], [0.1, 0.5], [0.25, 0.4]]
)


@pytest.fixture(scope="session")
def compiled_vase_scene():
    return Scene(("plate", "bowl", "glass", "cup"), "vase")


@pytest.fixture(scope="session")
def compiled_spoon_scene():
    return Scene(("bowl", "plate", "cup", "glass", "fork", "knife"), "spoon")


@pytest.fixture
def vase_scene(compiled_vase_scene):
    """Four things laid, a vase to be placed; as after a reset."""
    compiled_vase_scene.reset(VASE_LAYOUT)
    return compiled_vase_scene


@pytest.fixture
def spoon_scene(compiled_spoon_scene):
    """Six things laid, a spoon to be placed; as after a reset."""
    compiled_spoon_scene.reset(SPOON_LAYOUT)
    return compiled_spoon_scene
