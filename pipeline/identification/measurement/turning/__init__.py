"""Records of a turning drive: the output's error over the crank angle while a torque is held, in one sense or both."""
