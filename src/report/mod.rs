//! What a person or a script gets to see: a table, files, pictures, a page.

mod csv;
mod data;
mod driven;
mod file;
pub mod folder;
mod html;
pub(crate) mod lock;
mod losses;
mod manifest;
pub mod npz;
mod page;
#[cfg(feature = "plots")]
#[doc(hidden)]
pub mod plot;
mod run;
mod tables;
pub mod terminal;

#[cfg(feature = "cli")]
pub(crate) use csv::{field, spelled};
pub use file::File;
#[cfg(feature = "cli")]
pub(crate) use html::{escaped, html};
#[cfg(feature = "cli")]
pub(crate) use manifest::SCENE;
pub use manifest::all;
#[doc(hidden)]
pub use manifest::{after, at_the_end, fragment};
pub use run::{run_into, unanswered_into};
