"""Scenarios from elsewhere: bundled scenes scaled to a robot, files of users, and terrains."""
