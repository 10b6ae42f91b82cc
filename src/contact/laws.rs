//! The contact laws that a scene can name by `law`: a new one is a file of its own and its two lines here.

mod polynomial;
mod power;
mod table;

use super::kind::Kind;

/// Every kind of law.
pub const LAWS: &[Kind] = &[power::KIND, polynomial::KIND, table::KIND];
