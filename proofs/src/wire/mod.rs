//! T1, T2 and T8: what crosses the wire.
//!
//! | module | properties |
//! |---|---|
//! | [`parsing`] | T1: a frame is taken exactly when the byte tables say so, and says what they say |
//! | [`link`] | T1: all or nothing at both ends, T2: what one end sends the other understands |
//! | [`sequence`] | T8: no old frame counts, and the ends always find each other again |
//! | [`checksum`] | T1: the guarded frames' CRC and the errors it catches |
//! | [`codes`] | T2: codes to units and back |

pub mod checksum;
pub mod codes;
pub mod link;
pub mod parsing;
pub mod sequence;
pub mod table;
