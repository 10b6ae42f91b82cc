//! The paper, reproduced: folders of scenes with the paper's numbers, compared one by one.
//!
//! A folder holds `paper.csv`, the scenes its items name, and, if it likes, `about.md`. Each line of
//! `paper.csv` is an item: a number of a scene's results, what the paper prints for it and to which
//! digit, where, and what explains a difference. An explanation is itself a number that has to match:
//! see [`item`].

mod cosines;
mod damping;
pub mod equations;
mod evidence;
pub mod folder;
pub mod item;
pub mod numbers;
mod pictures;
pub mod readme;
mod roots;
mod run;
pub mod spectra;
