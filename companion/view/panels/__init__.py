"""What is read and chosen beside the picture: panels, charts, and the timeline under it."""
