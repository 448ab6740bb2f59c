"""What a reducer looks like: drawings, meshes, and files of them for other programs."""
