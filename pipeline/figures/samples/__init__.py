"""What the samples of a study, or its worst cases, come to."""
