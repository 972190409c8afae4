"""Placement rewards: RBFs on objects and table, and where the item is best put."""
