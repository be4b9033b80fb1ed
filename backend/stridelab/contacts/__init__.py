"""Where and when a robot touches its surroundings: terrain, contact phases, their check, swing curves."""
