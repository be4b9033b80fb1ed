"""Random scenarios of twelve classes for three robots: what the survey of terrains plans, certifies and replays."""
