"""The table, what stands on it, and the arm, in MuJoCo."""

from tablesetting.scene.environment import load as load
