//! What a person or a script gets to see: a table, files, pictures, a page.

pub mod data;
mod file;
pub mod folder;
mod losses;
mod manifest;
mod page;
pub mod plot;
pub mod terminal;

pub use file::File;
pub(crate) use manifest::at_the_start;
pub use manifest::{after, at_the_end};
pub(crate) use page::{escaped, html};
