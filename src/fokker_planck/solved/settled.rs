//! The stationary law of a friction that depends on the displacement, at resolutions that agree: what other questions start from or
//! compare with. `eigen::stationary` answers with its numbers and their errors.

use super::law::Law;
use super::on_mesh::OnMesh;
use crate::error::{Deadline, Error, Result};
use crate::fokker_planck::budget::timing;
use crate::fokker_planck::convergence::{UNKNOWN, left, left_of};
use crate::fokker_planck::hermite::{Kept, Resolution, heavy, work};
use crate::fokker_planck::policy::SETTLED_LAW_SHARE;
use crate::oscillator::Oscillator;

/// A stationary law at two resolutions, of which the finer is believed: what distances are taken to.
#[derive(Debug, Clone)]
pub(in crate::fokker_planck) struct Settled {
    pub(in crate::fokker_planck) law: Law,
    pub(in crate::fokker_planck) coarser: Law,
    /// What it may be off, in L1.
    pub(in crate::fokker_planck) error: f64,
    /// That over the distance of the two: what a difference of them leaves.
    pub(in crate::fokker_planck) left: f64,
}

/// The coarsest resolution of such a law in Hermite functions, and how many there are at most.
const FIRST: Resolution = Resolution {
    elements: 4,
    pairs: 16,
    level: 18.0,
};
const MOST: usize = 6;
/// Meshes at most, where Hermite functions do not reach what is asked: some seconds.
const MESHES: usize = 4;

/// Two laws are no farther apart in L1: where they seem to be, rounding spoils this resolution and finer ones.
pub(in crate::fokker_planck) const FARTHEST: f64 = 2.0;

/// Such a law, nearer and nearer: no resolution is solved for twice.
pub(in crate::fokker_planck) struct Approach<'a> {
    oscillator: &'a Oscillator,
    late: &'a Deadline<'a>,
    /// Bytes and seconds allowed, the seconds for one mesh, or one resolution in functions after the two that an answer takes.
    most: (u64, f64),
    /// In Hermite functions, the coarsest first.
    functions: Vec<Law>,
    on_mesh: Vec<Law>,
}

impl<'a> Approach<'a> {
    pub(in crate::fokker_planck) fn new(
        oscillator: &'a Oscillator,
        late: &'a Deadline,
        most: (u64, f64),
    ) -> Self {
        Self {
            oscillator,
            late,
            most,
            functions: Vec::new(),
            on_mesh: Vec::new(),
        }
    }

    /// The law to an L1 error of its share of a tolerance, or as near as resolutions get before rounding spoils a finer one: in
    /// Hermite functions, or on a mesh where that is nearer.
    pub(in crate::fokker_planck) fn within(&mut self, tolerance: f64) -> Result<Settled> {
        let (oscillator, late) = (self.oscillator, self.late);
        let fits = |bytes: u64, seconds: f64| {
            let full = || heavy(oscillator, "and finer ones do not fit their limits");
            let fits = bytes <= self.most.0 && seconds <= self.most.1;
            fits.then_some(()).ok_or_else(full)
        };
        let goal = SETTLED_LAW_SHARE.get() * tolerance;
        let functions = |level: usize| {
            let (bytes, operations) = work(FIRST.refined(level));
            // An answer takes two of them, whatever they take.
            let counted = if level < 2 { 0.0 } else { operations };
            fits(bytes, timing::OPERATION * counted)?;
            let law = Kept::new(oscillator, FIRST.refined(level), late)?;
            Ok(Law::Functions(law))
        };
        let functions = known(&mut self.functions, functions);
        let functions = Settled::of(oscillator, (MOST, goal), functions);
        if functions.as_ref().is_ok_and(|it| it.error <= goal) {
            return functions;
        }
        let on_mesh = |level: usize| {
            late()?;
            let it = OnMesh::work(oscillator, level)?;
            fits(it.memory, it.seconds)?;
            Ok(Law::OnMesh(OnMesh::new(oscillator, level)?))
        };
        let on_mesh = known(&mut self.on_mesh, on_mesh);
        match (functions, Settled::of(oscillator, (MESHES, goal), on_mesh)) {
            (Ok(a), Ok(b)) => Ok(if a.error < b.error { a } else { b }),
            (Ok(it), Err(_)) | (Err(_), Ok(it)) => Ok(it),
            (Err(error), Err(_)) => Err(error),
        }
    }
}

/// What was solved for before, else what is solved for now.
fn known(
    laws: &mut Vec<Law>,
    at: impl Fn(usize) -> Result<Law>,
) -> impl FnMut(usize) -> Result<Law> {
    move |level| {
        if level == laws.len() {
            laws.push(at(level)?);
        }
        Ok(laws[level].clone())
    }
}

impl Settled {
    /// Bytes and operations of the two resolutions that most laws take.
    pub(in crate::fokker_planck) fn work() -> (u64, f64) {
        let [first, second] = [FIRST, FIRST.refined(1)].map(work);
        (second.0, first.1 + second.1)
    }

    /// The law within its share of a tolerance ([`Approach::within`]).
    pub(in crate::fokker_planck) fn within(
        oscillator: &Oscillator,
        tolerance: f64,
        late: &Deadline,
        memory: u64,
    ) -> Result<Self> {
        Approach::new(oscillator, late, (memory, f64::INFINITY)).within(tolerance)
    }

    /// As near to `goal` as so many resolutions of one kind come.
    fn of(
        oscillator: &Oscillator,
        (most, goal): (usize, f64),
        mut at: impl FnMut(usize) -> Result<Law>,
    ) -> Result<Self> {
        let mut coarser = at(0)?;
        let mut best: Option<Self> = None;
        let mut before = None;
        for level in 1..most {
            let law = match at(level) {
                Err(Error::Linear { .. } | Error::Unresolved { .. } | Error::Mesh { .. })
                    if best.is_some() =>
                {
                    break;
                }
                law => law?,
            };
            let change = law.distance(&coarser);
            if change > FARTHEST && best.is_some() {
                break;
            }
            let error = before.map_or(left(UNKNOWN) * change, |it| left_of([it, change]))
                + left(UNKNOWN) * law.rounding();
            before = Some(change);
            let coarser = std::mem::replace(&mut coarser, law.clone());
            let known = best.as_ref().map_or(f64::INFINITY, |it: &Self| it.error);
            if error < known && change <= FARTHEST {
                best = Some(Self {
                    law,
                    coarser,
                    error,
                    left: error / change.max(f64::MIN_POSITIVE),
                });
            }
            if error <= goal {
                break;
            }
        }
        best.ok_or_else(|| heavy(oscillator, "and no two resolutions agree"))
    }
}
