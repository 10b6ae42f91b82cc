//! The tests of the laboratory: part of its program, where they reach its code.

mod calibration;
mod surveys;
mod validation;
