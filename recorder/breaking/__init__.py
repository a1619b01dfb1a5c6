"""Search for the mildest condition in which a SLAM system fails."""
