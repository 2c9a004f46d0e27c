//! T1, T2 and T8: what crosses the wire.

pub mod checksum;
pub mod codes;
pub mod link;
pub mod parsing;
pub mod sequence;
pub mod table;
