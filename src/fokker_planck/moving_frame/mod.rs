//! A local grid that moves with a narrow density.

pub(crate) mod frame;
pub(crate) mod packet;
