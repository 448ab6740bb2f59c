"""Many measured units against the distributions of a study."""
