//! A polynomial force, up to cubic: Duffing's oscillator, two wells.

use crate::contact::kind::Kind;
use crate::contact::parameters::{Parameter, Parameters, full};
use crate::contact::piece::{self, Piece};
use crate::contact::restoring::Restoring;
use crate::error::{Error, Result};
use crate::format::num;
use std::sync::Arc;

pub(super) const KIND: Kind = Kind {
    name: "polynomial",
    keys: &["coefficients"],
    make,
};

/// G = c1 q + c2 q^2 + c3 q^3.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Polynomial {
    given: Vec<f64>,
    piece: [Piece; 1],
}

fn make(parameters: &Parameters) -> Result<Arc<dyn Restoring>> {
    let what = "one to three numbers, of q, q^2 and q^3, as [1.0, 0.0, 0.1]";
    let given = parameters.numbers("coefficients")?.unwrap_or_default();
    if !(1..=3).contains(&given.len()) {
        return Err(parameters.refuse("coefficients", what));
    }
    let at = |k: usize| given.get(k).copied().unwrap_or(0.0);
    let [c1, c2, c3] = [at(0), at(1), at(2)];
    let confines = c3 > 0.0 || (c3 == 0.0 && c2 == 0.0 && c1 > 0.0);
    if !confines {
        let shown: Vec<String> = given.iter().map(|c| num(*c)).collect();
        let accepted = "a force that confines: the last coefficient that is not 0 is that of q or of q^3, and > 0";
        let value = format!("[{}]", shown.join(", "));
        return Err(Error::invalid(full("coefficients"), value, accepted));
    }
    Ok(Arc::new(Polynomial {
        given: given.to_vec(),
        piece: [Piece {
            from: f64::NEG_INFINITY,
            centre: 0.0,
            coefficients: [0.0, c1, c2, c3],
        }],
    }))
}

impl Restoring for Polynomial {
    fn name(&self) -> &'static str {
        KIND.name
    }

    fn force(&self, q: f64) -> f64 {
        self.piece[0].force(q)
    }

    fn potential(&self, q: f64) -> f64 {
        self.piece[0].work(q)
    }

    fn stiffness(&self, q: f64) -> f64 {
        self.piece[0].stiffness(q)
    }

    fn loss_point(&self) -> Option<f64> {
        None
    }

    fn roots(&self, force: f64) -> Vec<f64> {
        piece::roots(&self.piece, force)
    }

    fn pieces(&self) -> &[Piece] {
        &self.piece
    }

    fn parameters(&self) -> Parameters {
        Parameters::new().with("coefficients", Parameter::Numbers(self.given.clone()))
    }
}
