//! What the robot senses beside its wheels: the battery's cells and the distance to what is around.
