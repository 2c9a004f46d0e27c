//! Motors, wheels, encoders, battery, room and rangefinders of the virtual robot.
