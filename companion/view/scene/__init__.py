"""The picture in three dimensions: the drones, their paths, the ground and the cameras."""
