"""The table, what stands on it, and the arm, in MuJoCo."""
