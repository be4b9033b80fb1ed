"""Section 4.3: where the centre of mass can be, seen from an effector in contact."""
