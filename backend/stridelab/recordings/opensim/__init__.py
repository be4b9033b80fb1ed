"""Body models of OpenSim: their file (.osim), their forward kinematics, and trials of a model and its joint angles."""
