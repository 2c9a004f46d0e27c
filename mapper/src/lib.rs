//! Log-odds occupancy grid from poses and ranges.
