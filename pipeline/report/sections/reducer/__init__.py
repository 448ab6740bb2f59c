"""What was studied: the reducer, how it carries load, how it twists, and what a turn does."""
