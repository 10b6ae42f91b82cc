//! A contact law that a scene can name.

use super::parameters::Parameters;
use super::restoring::Restoring;
use crate::error::Result;
use std::sync::Arc;

/// A kind of contact law that a scene can name.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// The name of the law.
    pub name: &'static str,
    /// Its keys next to `law`.
    pub keys: &'static [&'static str],
    /// Makes one; what is wrong is named by its key.
    pub(crate) make: fn(&Parameters) -> Result<Arc<dyn Restoring>>,
}
