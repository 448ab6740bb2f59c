"""The stages of a study, one file each; `stages.chain` has them in order."""
