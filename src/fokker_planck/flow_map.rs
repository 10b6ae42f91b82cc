//! Transport by the exact flow, noise by the exact Ornstein-Uhlenbeck step: the fastest accurate
//! transient of a weakly damped oscillator.
//!
//! The ratio g = p/p_s is carried unchanged along the undamped motion, g <- g o Phi_{-tau}, and averaged
//! along v by friction with noise, a Gaussian average in closed form. Both keep g = 1. Between them a
//! near-integrable splitting (McLachlan, BIT 35, 258, 1995; Laskar and Robutel, Celest. Mech. Dyn.
//! Astron. 80, 39, 2001): Gauss quadrature of the noise along the motion, error O(zeta tau^n + zeta^2
//! tau^2), so a step spans a good part of a period. There is no bound on the step from the mesh. The second
//! term only runs the motion at a wrong rate: it is given the right one (splitting.rs), and of zeta^2 tau^2
//! remains zeta^2 tau^4, zeta^2 tau^3 from the ends of an interval of even steps.
//!
//! Seen from the moving point, noise adds up along the orbit; the splittings of Gauss type are a
//! composite rule for that integral. The even one is the trapezoidal rule, one pass of the motion a
//! step, whose only error of note comes from the ends of the interval and is corrected there.
//!
//! In space g is a spline of degree 7 through its values at the cell centres. One pass over the mesh
//! carries g along the motion; the matrix that then averages it along v also turns the result into the
//! spline coefficients of the next pass.
//!
//! - Edge: departure points outside the box take the value of g at the nearest centre, as does the
//!   average along v; g = 1 stays. Orbits that do not close inside the box hold no unknowns: along each
//!   row g continues as a constant beyond them. For a contact without a stationary law, where g is the
//!   density p itself, nothing comes in from outside and what leaves is lost.
//! - Mass: interpolation keeps it to its own error. A constant is added to g that keeps it exactly;
//!   constants pass unchanged through every part of a step, so one addition at the end is the same as
//!   one in every step. The raw defect is reported: a free measure of the interpolation error.
//! - Loss of contact: g bends there, its second derivative along q by a jump of the stiffness (bilinear) or
//!   without bound (Hertz), and where orbits graze it no expansion holds. Each pass leaves an error of order 3
//!   there, which adds up over the passes: fewer, longer steps are not only cheaper but more accurate.
//! - Short steps: where a pass moves most points by less than a fifth of a cell the shortest waves along
//!   q are not damped, and hundreds of such passes let them grow ([`FlowMap::shortest_step`]).
//! - Sign: no linear scheme of this order is positive. The negative mass is reported.

mod pass;
mod splitting;

pub use splitting::Splitting;

use super::density::Density;
use super::flux::{Drift, Measure, Weights};
use super::forcing::Forcing;
use super::interpolation::{Filter, MARGIN, PANEL, POINTS, Spline};
use super::mesh::{Axis, Mesh};
use super::ornstein_uhlenbeck;
use super::trajectory::Motion;
use crate::contact::ContactLaw;
use crate::error::{Error, Result, positive};
use crate::initial::Initial;
use crate::oscillator::Oscillator;
use pass::{Buffers, Map, Matrix, STENCIL};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// How to propagate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Splitting in time.
    pub splitting: Splitting,
    /// Longest step tau; each interval between outputs is divided into equal steps not above it.
    pub step: f64,
}

impl Default for Settings {
    /// Order 8, even steps of 1.
    fn default() -> Self {
        Self {
            splitting: Splitting::EvenFive,
            step: 1.0,
        }
    }
}

impl Settings {
    /// Longest useful step: a quarter of a period, beyond which the trapezoidal rule no longer sees the
    /// second harmonic of the motion.
    pub(crate) const LONGEST: f64 = 1.5;

    /// Order 8 and even steps for an L1 error of about `tolerance` from the splitting, at any time, for
    /// a start about as wide as half the stationary law; a narrower start needs a shorter step.
    /// Measured for the linear and the Hertz law, zeta = 1e-4 to 2: below min(0.036 zeta, 6e-4) tau^5 +
    /// 0.06 zeta^2 tau^3.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a tolerance that is not positive.
    pub fn to(tolerance: f64, oscillator: &Oscillator) -> Result<Self> {
        positive("accuracy.tolerance", tolerance)?;
        let (ends, second) = error_constants(oscillator);
        let step = (tolerance / ends)
            .powf(0.2)
            .min((tolerance / second).cbrt());
        Ok(Self {
            step: step.min(Self::LONGEST),
            ..Self::default()
        })
    }
}

/// The constants of tau^5 and tau^3 in the L1 error of even steps.
fn error_constants(oscillator: &Oscillator) -> (f64, f64) {
    let zeta = oscillator.zeta();
    ((0.036 * zeta).min(6e-4), 0.06 * zeta * zeta)
}

impl Settings {
    /// The L1 error of the splitting with these steps, as [`Settings::to`] takes it; up to
    /// [`Settings::LONGEST`].
    pub(crate) fn splitting_error(&self, oscillator: &Oscillator) -> f64 {
        let (ends, second) = error_constants(oscillator);
        ends * self.step.powi(5) + second * self.step.powi(3)
    }
}

impl Settings {
    /// Steps, passes over the mesh and flow maps of a run through `times`, whose intervals are cut into
    /// chunks of at most `chunk` steps.
    pub(super) fn size(&self, times: &[f64], chunk: f64) -> [f64; 3] {
        let (mut steps, mut passes, mut now) = (0.0, 0.0, 0.0);
        let mut motions: Vec<f64> = Vec::new();
        let mut known: Vec<(f64, f64)> = Vec::new();
        for t in times {
            let duration = t - now;
            now = *t;
            if duration <= 0.0 {
                continue;
            }
            let chunks = (duration / (chunk * self.step)).ceil().max(1.0);
            let interval = duration / chunks;
            let count = (interval / self.step - 1e-9).ceil().max(1.0);
            let same = |x: f64, y: f64| (x - y).abs() <= 1e-9 * interval;
            steps += chunks * count;
            if let Some((_, each)) = known.iter().find(|(it, _)| same(*it, interval)) {
                passes += chunks * each;
                continue;
            }
            let (mut nodes, _) = self.splitting.quadrature(count as usize);
            nodes.push(count);
            let tau = interval / count;
            let mut before = 0.0;
            for node in &nodes {
                let motion = (node - before) * tau;
                before = *node;
                if !motions.iter().any(|it| same(*it, motion)) {
                    motions.push(motion);
                }
            }
            known.push((interval, nodes.len() as f64));
            passes += chunks * nodes.len() as f64;
        }
        [steps, passes, motions.len() as f64]
    }

    /// Bytes of a map and of everything else, per cell.
    pub(super) fn bytes() -> [f64; 2] {
        // Values, panels, coefficients, the density and what observables and outputs copy.
        [8.0 * STENCIL as f64 + 4.0, 10.0 * 8.0]
    }
}

/// Flow maps that are held at once at most.
pub(super) const HELD: f64 = KEPT as f64 + 5.0;

/// What propagation did so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    /// Steps taken.
    pub steps: usize,
    /// Passes of the undamped motion over the mesh.
    pub passes: usize,
    /// Change of the mass by interpolation, before its correction: the sum of the absolute values over
    /// the intervals. For a contact without a stationary law, the mass that left the box.
    pub defect: f64,
    /// Largest negative mass at the end of an interval.
    pub negative: f64,
}

/// Matrices along v, each for some rows.
type Blocks = Vec<(Range<usize>, Matrix)>;

/// The propagator of an oscillator on a mesh.
#[derive(Debug, Clone)]
pub struct FlowMap {
    contact: ContactLaw,
    zeta: f64,
    temperature: f64,
    /// Rows of equal friction and their rate c, where it depends on the displacement, and pi h.
    frictions: Vec<(Range<usize>, f64)>,
    noise: f64,
    /// Whether g is taken against a stationary law, or against area.
    stationary: bool,
    /// What there is beside stationary noise, and 1/T of the law that g is then taken against (0: area).
    forcing: Option<(Arc<Forcing>, f64)>,
    /// The time.
    now: f64,
    mesh: Mesh,
    weights: Weights,
    settings: Settings,
    spline: Spline,
    /// Cells per q row on orbits that close inside the box.
    active: Vec<Range<usize>>,
    /// Number of active cells in the rows before.
    offsets: Vec<usize>,
    /// Values to coefficients along v, without noise.
    open: Blocks,
    /// Flow maps by their time.
    maps: Vec<(f64, Map)>,
    /// Matrices by what they do, each for some rows.
    matrices: Vec<(Noise, Blocks)>,
    schedule: Schedule,
    progress: Progress,
    buffers: Buffers,
}

/// Places and weights of some rows of a map.
type Part<'a> = (&'a mut [u32], &'a mut [f64]);

/// An interval: H and O in turn, then a last H. Places in the lists of maps and matrices.
#[derive(Debug, Clone)]
struct Schedule {
    duration: f64,
    /// When it began, where that matters.
    start: f64,
    steps: usize,
    parts: Vec<(usize, usize)>,
    last: usize,
}

/// Friction with noise over a time; under a forcing at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Noise {
    duration: f64,
    at: f64,
    /// What the splitting leads by ([`Forcing::shift`]), and a nudge of v.
    lead: f64,
    nudge: f64,
}

/// Widest cell in thermal deviations: the midpoint sum of a Gaussian is then off by
/// 2 exp(-2 pi^2/2^2) = 1 %, and no density of interest is narrower.
const WIDEST: f64 = 2.0;
/// Flow maps beyond which all are dropped before new ones are built: intervals of many lengths.
const KEPT: usize = 24;
/// Cells from which on the work of a stage is worth sharing between threads.
const SHARED: usize = 6000;

impl FlowMap {
    /// The propagator of `oscillator` on `mesh`.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a step that is not positive; [`Error::Mesh`] for fewer than eight cells in a
    /// direction, or a box where the stationary law underflows.
    pub fn new(oscillator: &Oscillator, mesh: &Mesh, settings: Settings) -> Result<Self> {
        Self::forced(oscillator, mesh, settings, None)
    }

    /// The propagator under a drive or an envelope too, from time 0 on; g is then taken against the law of
    /// [`Forcing::reference`].
    ///
    /// # Errors
    /// Those of [`FlowMap::new`].
    pub(super) fn forced(
        oscillator: &Oscillator,
        mesh: &Mesh,
        settings: Settings,
        forcing: Option<Arc<Forcing>>,
    ) -> Result<Self> {
        positive("method.step", settings.step)?;
        let [nq, nv] = mesh.cells();
        if nq.min(nv) < 8 {
            return Err(Error::Mesh {
                what: format!("{nq} x {nv} cells, and the stencil needs 8 in each direction"),
                help: "more cells".into(),
            });
        }
        let reference = forcing.as_ref().map_or(oscillator, |it| it.reference());
        let measure = Measure::of(reference)?;
        let temperature = oscillator.temperature();
        let width = mesh.v.at(0.5 * nv as f64).1 / temperature.sqrt();
        if matches!(measure, Measure::Gibbs(_)) && width > WIDEST {
            return Err(Error::Mesh {
                what: format!("a cell of the {nv} along v is {width:.1} thermal deviations wide"),
                help: format!("about {:.0} cells along v", (nv as f64 * width).ceil()),
            });
        }
        let weights = Weights::new(&measure, mesh, reference.temperature(), Drift::Order8)?;
        let weights = weights.without_rim();
        let stationary = matches!(measure, Measure::Gibbs(_));
        let beta = if stationary {
            1.0 / reference.temperature()
        } else {
            0.0
        };
        let contact = oscillator.contact().clone();
        let active = active(&contact, mesh, stationary);
        let mut offsets = vec![0];
        for range in &active {
            offsets.push(offsets[offsets.len() - 1] + range.len());
        }
        let stride = (nv + 2 * MARGIN).next_multiple_of(PANEL);
        let open = vec![(0..nq, Matrix::new(nv, stride, None))];
        Ok(Self {
            contact,
            zeta: oscillator.zeta(),
            temperature,
            frictions: frictions(oscillator, mesh)?,
            noise: oscillator.noise(),
            stationary,
            forcing: forcing.map(|it| (it, beta)),
            now: 0.0,
            mesh: mesh.clone(),
            weights,
            settings,
            spline: Spline::new(),
            active,
            offsets,
            open,
            maps: Vec::new(),
            matrices: Vec::new(),
            schedule: Schedule {
                duration: 0.0,
                start: 0.0,
                steps: 0,
                parts: Vec::new(),
                last: 0,
            },
            progress: Progress::default(),
            buffers: Buffers {
                filter: Filter::new(nq),
                values: vec![0.0; nq * nv],
                panels: vec![0.0; nq * stride],
                coefficients: vec![0.0; (nq + 2 * MARGIN) * stride],
                stride,
            },
        })
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The measure of the cells that g is taken against.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The cells of each q-column on orbits that close inside the box: those that hold unknowns.
    pub fn columns(&self) -> &[Range<usize>] {
        &self.active
    }

    pub(crate) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Shortest step that lets no grid noise grow: a point at the thermal speed crosses a quarter of a cell.
    /// Measured at zeta = 1e-3 and 0.005 to t = 150, on 60 x 44 and 90 x 66 cells: waves as short as the mesh
    /// stay as they are from 0.26 cells on, grow by a third at 0.17, and thirtyfold at 0.1.
    pub fn shortest_step(oscillator: &Oscillator, mesh: &Mesh) -> f64 {
        if !oscillator.contact().is_confining() {
            return 0.0;
        }
        let (_, width) = mesh.q.at(mesh.q.locate(0.0));
        0.25 * width / oscillator.temperature().sqrt()
    }

    /// Whether there is anything beside stationary noise.
    pub(super) fn is_forced(&self) -> bool {
        self.forcing.is_some()
    }

    /// Sets the time, which an excitation goes by.
    pub(super) fn set_time(&mut self, t: f64) {
        self.now = t;
    }

    /// The time.
    pub(super) fn time(&self) -> f64 {
        self.now
    }

    /// Steps, mass defect and negative mass so far.
    pub fn progress(&self) -> Progress {
        self.progress
    }

    /// A start at the cell centres.
    ///
    /// # Errors
    /// As [`Density::start`].
    pub fn start(&self, initial: &Initial) -> Result<Density> {
        Density::everywhere(&self.mesh, &self.weights, initial)
    }

    /// g = P/w of a density on this mesh, row-major.
    pub fn ratio(&self, density: &Density) -> Vec<f64> {
        let mut g = density.cells().to_vec();
        for (row, wq) in g.chunks_exact_mut(self.mesh.v.len()).zip(&self.weights.q) {
            for (g, wv) in row.iter_mut().zip(&self.weights.v) {
                *g /= wq * wv;
            }
        }
        g
    }

    /// Propagates a density on this mesh over `duration`, in equal steps of at most [`Settings::step`].
    /// Flow maps and matrices are built for the first interval that needs a step length, and kept.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a duration that is negative or not finite, or a density on another mesh.
    pub fn advance(&mut self, density: &mut Density, duration: f64) -> Result<()> {
        self.advance_watched(density, duration, &|| Ok(()))
    }

    /// The same, ended by `late`, which is asked before each group of rows that is traced and before each pass.
    ///
    /// # Errors
    /// Those of [`FlowMap::advance`] and of `late`.
    pub(super) fn advance_watched(
        &mut self,
        density: &mut Density,
        duration: f64,
        late: &(dyn Fn() -> Result<()> + Sync),
    ) -> Result<()> {
        if !(duration.is_finite() && duration >= 0.0) {
            let accepted = "a finite duration, not negative";
            return Err(Error::invalid("outputs.moments_at", duration, accepted));
        }
        if density.cells().len() != self.mesh.len() {
            let [nq, nv] = self.mesh.cells();
            let given = format!("{} cells", density.cells().len());
            return Err(Error::invalid(
                "the density",
                given,
                format!("one on {nq} x {nv} cells"),
            ));
        }
        // Over such a time noise spreads by less than a rounding of v, and motion by less than one of q.
        if duration < 1e-20 {
            return Ok(());
        }
        self.prepare(duration, late)?;
        self.read(density);
        let before = self.mass();
        if self.shared() {
            // Inside the pool for good: its queues are then the only ones used.
            rayon::scope(|_| self.run(true, late))?;
        } else {
            self.run(false, late)?;
        }
        self.balance(before);
        self.now += duration;
        self.write(density);
        let negative = density.negative_mass();
        self.progress.negative = self.progress.negative.max(negative);
        Ok(())
    }

    /// Whether threads share the work of a stage.
    fn shared(&self) -> bool {
        self.mesh.len() >= SHARED && rayon::current_num_threads() > 1
    }

    /// The schedule of an interval, and the maps and matrices that it still lacks.
    fn prepare(&mut self, duration: f64, late: &(dyn Fn() -> Result<()> + Sync)) -> Result<()> {
        let same_time = self.forcing.is_none() || self.schedule.start == self.now;
        if self.schedule.duration == duration && same_time {
            return Ok(());
        }
        let steps = (duration / self.settings.step - 1e-9).ceil().max(1.0);
        let tau = duration / steps;
        let (nodes, weights) = self.settings.splitting.quadrature(steps as usize);
        // Intervals between output times differ by the rounding of the times: the same maps serve.
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * duration;
        if self.maps.len() > KEPT {
            self.maps.clear();
            self.matrices.clear();
        }
        if self.forcing.is_some() {
            // What one node does no other does again.
            self.matrices.clear();
        }
        // Kept: what this interval may use again.
        let (mut motions, mut noises): (Vec<f64>, Vec<Noise>) = (
            self.maps.iter().map(|m| m.0).collect(),
            self.matrices.iter().map(|m| m.0).collect(),
        );
        let number = |list: &mut Vec<f64>, time: f64| {
            let place = list.iter().position(|x| near(*x, time));
            place.unwrap_or_else(|| {
                list.push(time);
                list.len() - 1
            })
        };
        let forced = self.forcing.is_some();
        let noise_number = |list: &mut Vec<Noise>, noise: Noise| {
            let same = |x: &Noise| {
                let rest = |x: &Noise| (x.at, x.lead, x.nudge);
                near(x.duration, noise.duration) && rest(x) == rest(&noise)
            };
            let place = list.iter().position(same);
            place.unwrap_or_else(|| {
                list.push(noise);
                list.len() - 1
            })
        };
        // A rate that changes from place to place has no single lead.
        let lead = if self.frictions.is_empty() {
            splitting::lead(&nodes, &weights, steps, self.zeta * tau)
        } else {
            0.0
        };
        let pace = tau * (1.0 + lead);
        let nudges = self.nudges(&nodes, (steps, tau), lead);
        let mut before = 0.0;
        let mut parts = Vec::with_capacity(nodes.len());
        for (k, (node, weight)) in nodes.iter().zip(&weights).enumerate() {
            let motion = number(&mut motions, (node - before) * pace);
            let noise = Noise {
                duration: weight * tau,
                at: if forced { self.now + node * tau } else { 0.0 },
                lead: if forced { lead } else { 0.0 },
                nudge: nudges.get(k).copied().unwrap_or(0.0),
            };
            parts.push((motion, noise_number(&mut noises, noise)));
            before = *node;
        }
        let last = number(&mut motions, (steps - before) * pace);
        self.schedule = Schedule {
            duration,
            start: self.now,
            steps: steps as usize,
            parts,
            last,
        };
        for noise in &noises[self.matrices.len()..] {
            let matrices = self.averages(noise, late)?;
            self.matrices.push((*noise, matrices));
        }
        let times = &motions[self.maps.len()..];
        if !times.is_empty() {
            let maps = self.maps(times, late)?;
            self.maps.extend(times.iter().copied().zip(maps));
        }
        Ok(())
    }

    /// What to nudge v by at each node of an interval of `steps` steps from now on, for the kicks that a drive asks for where
    /// it begins and ends ([`Forcing`]): each is shared out between the two nodes next to it so that neither what it does to v
    /// nor what v then does to q is changed. Empty without a drive.
    fn nudges(&self, nodes: &[f64], (steps, tau): (f64, f64), lead: f64) -> Vec<f64> {
        let Some((forcing, _)) = &self.forcing else {
            return Vec::new();
        };
        let n = nodes.len();
        let mut nudges = vec![0.0; n];
        let (begin, end) = (self.now, self.now + steps * tau);
        let [first, last] = [begin, end].map(|t| forcing.ahead(t, lead));
        if n < 2 {
            return nudges;
        }
        let shares = |near: f64, far: f64| [far / (far - near), near / (near - far)];
        let at_begin = shares(nodes[0], nodes[1]);
        let at_end = shares(steps - nodes[n - 1], steps - nodes[n - 2]);
        nudges[0] -= first * at_begin[0];
        nudges[1] -= first * at_begin[1];
        nudges[n - 1] += last * at_end[0];
        nudges[n - 2] += last * at_end[1];
        nudges
    }

    /// Friction with noise over a time, for all rows at once or for those of equal friction.
    fn averages(&self, what: &Noise, late: &(dyn Fn() -> Result<()> + Sync)) -> Result<Blocks> {
        let ([nq, n], stride) = (self.mesh.cells(), self.buffers.stride);
        let (axis, temperature) = (&self.mesh.v, self.temperature);
        let time = what.duration;
        if let Some((forcing, beta)) = &self.forcing {
            let kick = forcing.kick(what.at, time, (what.lead, what.nudge), *beta);
            let average = kick.average(axis, self.stationary);
            return Ok(vec![(0..nq, Matrix::new(n, stride, Some(&average)))]);
        }
        if self.frictions.is_empty() {
            let friction = 2.0 * self.zeta * time;
            let average = ornstein_uhlenbeck::average(axis, friction, temperature, self.stationary);
            return Ok(vec![(0..nq, Matrix::new(n, stride, Some(&average)))]);
        }
        let noise = 2.0 * self.noise * time;
        let one = |(rows, rate): &(Range<usize>, f64)| {
            late()?;
            let average = ornstein_uhlenbeck::average_at(axis, rate * time, noise, temperature);
            Ok((rows.clone(), Matrix::new(n, stride, Some(&average))))
        };
        if rayon::current_num_threads() > 1 {
            self.frictions.par_iter().map(one).collect()
        } else {
            self.frictions.iter().map(one).collect()
        }
    }

    /// The flow maps of several times.
    fn maps(&self, times: &[f64], late: &(dyn Fn() -> Result<()> + Sync)) -> Result<Vec<Map>> {
        /// Rows of cells traced together.
        const ROWS: usize = 8;
        let [nq, _] = self.mesh.cells();
        let total = self.offsets[nq];
        let stencil = STENCIL;
        let mut sorted: Vec<usize> = (0..times.len()).collect();
        sorted.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
        let ascending: Vec<f64> = sorted.iter().map(|k| times[*k]).collect();
        let mut maps: Vec<Map> = times
            .iter()
            .map(|_| Map {
                places: vec![0; total],
                weights: vec![0.0; total * stencil],
            })
            .collect();
        // The part of every map that belongs to a group of rows.
        let mut groups: Vec<(usize, Vec<Part>)> =
            (0..nq).step_by(ROWS).map(|row| (row, Vec::new())).collect();
        for map in &mut maps {
            let (mut places, mut weights) = (&mut map.places[..], &mut map.weights[..]);
            for (row, parts) in &mut groups {
                let end = (*row + ROWS).min(nq);
                let count = self.offsets[end] - self.offsets[*row];
                let (p, rest) = places.split_at_mut(count);
                places = rest;
                let (w, rest) = weights.split_at_mut(count * stencil);
                weights = rest;
                parts.push((p, w));
            }
        }
        let motion = Motion::new(&self.contact);
        let trace = |(row, parts): &mut (usize, Vec<Part>)| {
            late()?;
            let end = (*row + ROWS).min(nq);
            let centres = (self.mesh.q.centres(), self.mesh.v.centres());
            let starts: Vec<[f64; 2]> = (*row..end)
                .flat_map(|i| {
                    self.active[i]
                        .clone()
                        .map(move |j| [centres.0[i], centres.1[j]])
                })
                .collect();
            let mut ends = vec![[0.0; 2]; starts.len() * ascending.len()];
            motion.before(&starts, &ascending, &mut ends);
            for (ends, k) in ends.chunks_exact(starts.len()).zip(&sorted) {
                let (places, weights) = &mut parts[*k];
                pulp::Arch::new().dispatch(Locate {
                    it: self,
                    ends,
                    places,
                    weights,
                });
            }
            Ok(())
        };
        if self.shared() {
            groups.par_iter_mut().try_for_each(trace)?;
        } else {
            groups.iter_mut().try_for_each(trace)?;
        }
        Ok(maps)
    }

    /// The scheduled interval; from values to values.
    fn run(&mut self, share: bool, late: &(dyn Fn() -> Result<()> + Sync)) -> Result<()> {
        let nv = self.mesh.v.len();
        let (buffers, schedule) = (&mut self.buffers, &self.schedule);
        let rows = (&self.active[..], &self.offsets[..]);
        buffers.average(nv, &self.open, share);
        for &(map, matrix) in &schedule.parts {
            late()?;
            buffers.carry(nv, &self.maps[map].1, rows, share);
            buffers.average(nv, &self.matrices[matrix].1, share);
        }
        buffers.carry(nv, &self.maps[schedule.last].1, rows, share);
        self.progress.steps += schedule.steps;
        self.progress.passes += schedule.parts.len() + 1;
        Ok(())
    }

    fn read(&mut self, density: &Density) {
        let nv = self.mesh.v.len();
        let rows = density.cells().chunks_exact(nv);
        let values = self.buffers.values.chunks_exact_mut(nv);
        for ((row, g), wq) in rows.zip(values).zip(&self.weights.q) {
            for ((p, g), wv) in row.iter().zip(g).zip(&self.weights.v) {
                *g = p / (wq * wv);
            }
        }
    }

    fn write(&self, density: &mut Density) {
        let nv = self.mesh.v.len();
        let rows = density.cells_mut().chunks_exact_mut(nv);
        let values = self.buffers.values.chunks_exact(nv);
        for ((row, g), wq) in rows.zip(values).zip(&self.weights.q) {
            for ((p, g), wv) in row.iter_mut().zip(g).zip(&self.weights.v) {
                *p = g * (wq * wv);
            }
        }
    }

    /// Sum of w f(g).
    fn sum(&self, f: impl Fn(f64) -> f64) -> f64 {
        let nv = self.mesh.v.len();
        let rows = self.buffers.values.chunks_exact(nv).zip(&self.weights.q);
        let row =
            |g: &[f64]| -> f64 { g.iter().zip(&self.weights.v).map(|(g, w)| f(*g) * w).sum() };
        rows.map(|(g, wq)| wq * row(g)).sum()
    }

    fn mass(&self) -> f64 {
        self.sum(|g| g)
    }

    /// Restores the mass.
    fn balance(&mut self, before: f64) {
        let defect = self.mass() - before;
        self.progress.defect += defect.abs();
        if self.stationary {
            let constant = defect / self.sum(|_| 1.0);
            for g in &mut self.buffers.values {
                *g -= constant;
            }
        }
    }
}

/// Stencils of departure points.
struct Locate<'a> {
    it: &'a FlowMap,
    ends: &'a [[f64; 2]],
    places: &'a mut [u32],
    weights: &'a mut [f64],
}

impl pulp::WithSimd for Locate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let it = self.it;
        let [nq, nv] = it.mesh.cells();
        let stride = it.buffers.stride;
        let (q_axis, v_axis) = (Coordinate::of(&it.mesh.q), Coordinate::of(&it.mesh.v));
        let cells = self.ends.iter().zip(self.places);
        for ((end, place), weights) in cells.zip(self.weights.chunks_exact_mut(STENCIL)) {
            let (xi, eta) = (q_axis.locate(end[0]), v_axis.locate(end[1]));
            let (iq, fq) = Spline::place(xi, nq);
            let (iv, fv) = Spline::place(eta, nv);
            *place = (iq * stride + iv) as u32;
            let inside = |x: f64, n: usize| x >= -0.5 && x <= n as f64 - 0.5;
            if it.stationary || (inside(xi, nq) && inside(eta, nv)) {
                weights[..POINTS].copy_from_slice(&it.spline.weights(fq));
                weights[POINTS..].copy_from_slice(&it.spline.weights(fv));
            }
        }
    }
}

/// Mesh coordinate of a place, counted from the first centre.
#[derive(Clone, Copy)]
enum Coordinate<'a> {
    Uniform { first: f64, inverse: f64 },
    Mapped(&'a Axis),
}

impl<'a> Coordinate<'a> {
    fn of(axis: &'a Axis) -> Self {
        if axis.is_uniform() {
            Self::Uniform {
                first: axis.centres()[0],
                inverse: 1.0 / axis.slopes()[0],
            }
        } else {
            Self::Mapped(axis)
        }
    }

    #[inline(always)]
    fn locate(self, x: f64) -> f64 {
        match self {
            Self::Uniform { first, inverse } => (x - first) * inverse,
            Self::Mapped(axis) => axis.locate(x) - 0.5,
        }
    }
}

/// Rows of equal friction, with their rate; none where it is the same everywhere.
fn frictions(oscillator: &Oscillator, mesh: &Mesh) -> Result<Vec<(Range<usize>, f64)>> {
    if oscillator.is_viscous() {
        return Ok(Vec::new());
    }
    oscillator
        .damping()
        .depends_on_displacement("the flow map")?;
    let mut all: Vec<(Range<usize>, f64)> = Vec::new();
    for (i, q) in mesh.q.centres().iter().enumerate() {
        let rate = oscillator.friction(*q);
        match all.last_mut() {
            Some((rows, last)) if *last == rate => rows.end = i + 1,
            _ => all.push((i..i + 1, rate)),
        }
    }
    Ok(all)
}

/// Per q row the cells on orbits that stay within the outermost centres; at least the two slowest.
fn active(contact: &ContactLaw, mesh: &Mesh, stationary: bool) -> Vec<Range<usize>> {
    let (q, v) = (mesh.q.centres(), mesh.v.centres());
    let [nq, nv] = mesh.cells();
    if !stationary {
        return vec![0..nv; nq];
    }
    let fastest = v[0].abs().min(v[nv - 1].abs());
    let level = contact
        .potential(q[0])
        .min(contact.potential(q[nq - 1]))
        .min(0.5 * fastest * fastest);
    q.iter()
        .map(|q| {
            let reach = (2.0 * (level - contact.potential(*q))).max(0.0).sqrt();
            let first = v.partition_point(|v| *v < -reach);
            let last = v.partition_point(|v| *v <= reach);
            let middle = v.partition_point(|v| *v < 0.0).clamp(1, nv - 1);
            first.min(middle - 1)..last.max(middle + 1)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fokker_planck::domain::Domain;

    fn mesh(oscillator: &Oscillator, initial: &Initial, cells: [usize; 2]) -> Mesh {
        let domain = Domain::closed(oscillator, initial, 1e-7).unwrap();
        let t = oscillator.temperature();
        Mesh {
            q: Axis::displacement(oscillator.contact(), t, domain.q, cells[0], 1).unwrap(),
            v: Axis::velocity(domain.v[1], cells[1], 1).unwrap(),
        }
    }

    fn start() -> Initial {
        Initial::gaussian([0.5, 0.0], [0.5, 0.5]).unwrap()
    }

    #[test]
    fn the_stationary_law_stays_on_any_mesh_with_any_splitting() {
        for (h, contact) in [
            (2e-3, ContactLaw::Hertz),
            (0.3, ContactLaw::Hertz),
            (2e-3, ContactLaw::Bilinear),
            (1e-6, ContactLaw::Linear),
        ] {
            let oscillator = Oscillator::new(contact, 0.005, h).unwrap();
            let mesh = mesh(&oscillator, &Initial::Stationary, [33, 26]);
            for splitting in Splitting::ALL {
                let settings = Settings {
                    splitting,
                    ..Settings::default()
                };
                let mut flow = FlowMap::new(&oscillator, &mesh, settings).unwrap();
                let mut density = flow.start(&Initial::Stationary).unwrap();
                flow.advance(&mut density, 200.0).unwrap();
                let g = flow.ratio(&density);
                let worst = g.iter().map(|g| (g - 1.0).abs()).fold(0.0, f64::max);
                assert!(worst < 1e-12, "{splitting:?}: {worst:e}");
            }
        }
    }

    #[test]
    fn mass_is_kept_to_rounding_and_its_raw_defect_is_the_interpolation_error() {
        let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        for (cells, bound) in [([60, 44], 1e-4), ([90, 66], 3e-5), ([120, 88], 1e-5)] {
            let mesh = mesh(&oscillator, &start(), cells);
            let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
            let mut density = flow.start(&start()).unwrap();
            let before = density.mass();
            flow.advance(&mut density, 50.0).unwrap();
            let change = (density.mass() - before).abs();
            let defect = flow.progress().defect;
            println!("{cells:?}: mass to {change:.1e}, raw defect {defect:.1e}");
            assert!(change < 1e-13 && defect < bound);
        }
    }

    #[test]
    fn the_bits_do_not_depend_on_the_number_of_threads() {
        let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        let mesh = mesh(&oscillator, &start(), [101, 83]);
        assert!(mesh.len() >= SHARED);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap().install(|| {
                let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
                let mut density = flow.start(&start()).unwrap();
                flow.advance(&mut density, 7.0).unwrap();
                density
            })
        };
        let one = run(1);
        for threads in [2, 3, 7] {
            assert_eq!(one.cells(), run(threads).cells(), "{threads} threads");
        }
    }

    #[test]
    fn output_times_are_hit_and_change_the_answer_by_the_splitting_error_only() {
        let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        let mesh = mesh(&oscillator, &start(), [120, 88]);
        let run = |parts: &[f64]| {
            let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
            let mut density = flow.start(&start()).unwrap();
            for part in parts {
                flow.advance(&mut density, *part).unwrap();
            }
            density
        };
        let whole = run(&[20.0]);
        let uneven: Vec<f64> = (1..=16).map(|k| 20.0 * f64::from(k) / 136.0).collect();
        for parts in [
            &[8.3, 11.7][..],
            &[0.01, 0.3, 9.0, 0.0, 10.69],
            &[2.5; 8],
            &uneven,
        ] {
            let distance: f64 = run(parts)
                .cells()
                .iter()
                .zip(whole.cells())
                .map(|(a, b)| (a - b).abs())
                .sum();
            println!("{parts:?}: L1 {distance:.1e}");
            assert!(distance < 3e-4);
        }
    }

    #[test]
    fn the_schedule_spends_exactly_its_interval_on_motion_and_on_noise() {
        for splitting in Splitting::ALL {
            for steps in 1..12 {
                let (nodes, weights) = splitting.quadrature(steps);
                let total: f64 = weights.iter().sum();
                assert!(
                    (total - steps as f64).abs() < 1e-12,
                    "{splitting:?} {steps}"
                );
                assert!(weights.iter().all(|w| *w > 0.0));
                assert!(nodes.windows(2).all(|w| w[0] < w[1]));
                assert!(nodes[0] > 0.0 && nodes[nodes.len() - 1] < steps as f64);
            }
        }
    }

    #[test]
    fn beyond_the_edge_g_goes_on_as_a_constant_and_a_density_as_nothing() {
        let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        // A box much too small: half of the stationary law lies outside.
        let mesh = Mesh {
            q: Axis::uniform(-1.2, 0.9, 30).unwrap(),
            v: Axis::uniform(-0.8, 0.8, 24).unwrap(),
        };
        let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
        let mut density = flow
            .start(&Initial::gaussian([0.2, 0.0], [0.2, 0.2]).unwrap())
            .unwrap();
        flow.advance(&mut density, 50.0).unwrap();
        let g = flow.ratio(&density);
        let (low, high) = g
            .iter()
            .fold((f64::MAX, f64::MIN), |(a, b), g| (a.min(*g), b.max(*g)));
        println!("too small a box: g within [{low:.3}, {high:.3}]");
        assert!(low > -0.1 && high < 20.0);

        let free = Oscillator::new(ContactLaw::Free, 0.005, 2e-3).unwrap();
        let mesh = Mesh {
            q: Axis::uniform(-2.0, 2.0, 40).unwrap(),
            v: Axis::uniform(-2.0, 2.0, 40).unwrap(),
        };
        let mut flow = FlowMap::new(&free, &mesh, Settings::default()).unwrap();
        let mut density = flow
            .start(&Initial::gaussian([0.0, 0.0], [0.3, 0.3]).unwrap())
            .unwrap();
        flow.advance(&mut density, 10.0).unwrap();
        println!("thrown out of the box: mass {:.1e} left", density.mass());
        assert!(density.mass().abs() < 1e-6);
        assert!((flow.progress().defect - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_step_or_duration_that_makes_no_sense_is_refused_by_name() {
        let oscillator = Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3).unwrap();
        let mesh = mesh(&oscillator, &start(), [60, 44]);
        for step in [0.0, -1.0, f64::NAN] {
            let settings = Settings {
                step,
                ..Settings::default()
            };
            let message = FlowMap::new(&oscillator, &mesh, settings)
                .unwrap_err()
                .to_string();
            assert!(message.contains("method.step"), "{message}");
        }
        let mut flow = FlowMap::new(&oscillator, &mesh, Settings::default()).unwrap();
        let mut density = flow.start(&start()).unwrap();
        assert!(flow.advance(&mut density, -1.0).is_err());
        assert!(flow.advance(&mut density, f64::NAN).is_err());
        assert!(Settings::to(0.0, &oscillator).is_err());
    }
}
