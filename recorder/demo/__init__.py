"""A recorded drive, shown: a first picture, sequences, SLAM systems and their errors."""
