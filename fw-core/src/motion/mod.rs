//! Where the robot is and how it gets where it should be.
