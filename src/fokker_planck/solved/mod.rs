//! The stationary law where friction depends on the displacement and no closed form is known: solved for in Hermite functions,
//! or on a mesh where these do not hold it.

mod law;
mod on_mesh;
mod settled;

pub(super) use law::{Column, Law};
pub(super) use on_mesh::OnMesh;
pub(super) use settled::{Approach, FARTHEST, Settled};
