"""What is read and chosen beside the picture, and the timeline under it."""
