"""Humanoids as data: model, effectors, position-level inverse kinematics, configuration sampling."""
