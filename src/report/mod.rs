//! What a person or a script gets to see: a table, files, pictures, a page.

mod csv;
pub mod data;
mod driven;
mod file;
pub mod folder;
mod losses;
mod manifest;
mod page;
pub mod plot;
mod run;
mod tables;
pub mod terminal;

pub(crate) use csv::spelled;
pub use file::File;
pub use manifest::{after, all, at_the_end, fragment};
pub(crate) use page::{escaped, html};
pub use run::run_into;
