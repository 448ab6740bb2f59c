"""Records of a turning drive without a model of its parts: a pair of encoders, held torques, both senses."""
