//! The radio: its actions (carrier and pulse), the pulse as the receiver sees it, and how both ends of a link change their
//! action together.

pub mod library;
pub mod link;
pub mod pulse;
