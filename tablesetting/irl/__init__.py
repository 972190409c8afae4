"""Inverse reinforcement learning: posterior, risk and the active loop."""
