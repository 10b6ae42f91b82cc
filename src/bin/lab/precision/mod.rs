//! Error against run time: every scheme on every case, against closed forms or against a finer run of
//! another method, with set-up included in every time. And error estimates against stored reference solutions:
//! [`calibration`].

pub mod by_hand;
pub mod calibration;
pub mod case;
mod clock;
pub mod cost;
pub mod entry;
pub mod judged;
pub mod method;
pub mod passages;
pub mod policy;
mod questions;
pub mod rates;
mod reference;
pub mod references;
mod solve;
pub mod table;
pub mod verdict;
