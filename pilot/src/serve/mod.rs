//! One process owns the robot, many look on: the control loop and its clients.
//!
//! | module | content |
//! |---|---|
//! | [`protocol`] | requests and messages |
//! | [`hub`] | bounded queues between the loop and its clients |
//! | [`control`] | the loop: lease, motions, frames to those who watch |
//! | [`tiles`] | the map in pieces |
//! | [`listener`] | Unix sockets, TCP |
//! | [`token`] | what clients over a network show |

pub mod control;
pub mod hub;
pub mod listener;
mod pacer;
pub mod protocol;
pub mod tiles;
pub mod token;
