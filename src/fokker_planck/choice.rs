//! What to compute with: the user's settings, and the mesh, scheme and step where they leave it open.

use super::density::Density;
use super::domain::Domain;
use super::flow_map::{self, FlowMap};
use super::flux::Drift;
use super::generator::Generator;
use super::march::{Additive, BackwardEuler, Chebyshev, Integrator, March, Radau, Solver, Step};
use super::mesh::{Axis, Mesh};
use super::propagator::Propagator;
use super::refinement::COARSE;
use crate::error::{Error, Result, positive};
use crate::initial::Initial;
use crate::oscillator::Oscillator;

/// Scheme in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeScheme {
    /// Backward Euler with one sparse LU: first order, positive with upwind drift.
    BackwardEuler,
    /// Radau IIA of order 5: steps bound by accuracy alone, each a real and a complex sparse solve.
    Implicit,
    /// Additive Runge-Kutta of order 4, friction and diffusion implicit: steps bound by transport.
    Imex,
    /// Chebyshev series of the exponential, matrix-free: stages bound by transport and diffusion.
    Explicit,
}

impl TimeScheme {
    /// Every scheme.
    pub const ALL: [Self; 4] = [
        Self::BackwardEuler,
        Self::Implicit,
        Self::Imex,
        Self::Explicit,
    ];

    /// The scheme of a name used in scenes.
    ///
    /// # Errors
    /// [`Error::Invalid`] for any other name.
    pub fn parse(name: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|scheme| scheme.name() == name)
            .ok_or_else(|| {
                let accepted = Self::ALL.map(|scheme| format!("\"{}\"", scheme.name()));
                Error::invalid("method.time", format!("\"{name}\""), accepted.join(", "))
            })
    }

    /// The name used in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::BackwardEuler => "backward_euler",
            Self::Implicit => "implicit",
            Self::Imex => "imex",
            Self::Explicit => "explicit",
        }
    }
}

/// How a density is carried forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransientMethod {
    /// Finite volumes with a scheme in time.
    FiniteVolume,
    /// The flow map: exact transport and exact noise in turn.
    FlowMap,
}

/// A method with its scheme in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// Finite volumes.
    Volumes(TimeScheme),
    /// The flow map.
    FlowMap,
}

impl Way {
    /// For tables.
    pub(super) fn name(self, drift: Drift) -> String {
        match self {
            Self::Volumes(time) => format!("finite volumes, {}, {}", drift.name(), time.name()),
            Self::FlowMap => "flow map, order 8".into(),
        }
    }
}

/// What a scene says about the Fokker-Planck solver; None is an automatic choice.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Finite volumes or flow map.
    pub method: Option<TransientMethod>,
    /// How g is carried across faces.
    pub drift: Option<Drift>,
    /// Scheme in time.
    pub time: Option<TimeScheme>,
    /// Cells in q and v.
    pub cells: Option<[usize; 2]>,
    /// Longest step in time; a stability limit may shorten it.
    pub step: Option<f64>,
    /// Error aimed at, relative to the natural scale of each number.
    pub tolerance: f64,
    /// Probability the box may leave out; None for as little as every bar needs, a thousandth of the
    /// tolerance at most.
    pub neglected: Option<f64>,
    /// Bytes that may be used.
    pub max_memory: u64,
    /// Seconds after which a run stops with an error.
    pub max_seconds: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: None,
            drift: None,
            time: None,
            cells: None,
            step: None,
            tolerance: 1e-3,
            neglected: None,
            max_memory: 8_000_000_000,
            max_seconds: 600.0,
        }
    }
}

/// What a result was computed with.
#[derive(Debug, Clone, PartialEq)]
pub struct Method {
    /// Name, scheme in space and in time.
    pub name: String,
    /// Why it was chosen.
    pub reason: String,
    /// Cells in q and v.
    pub cells: [usize; 2],
    /// Cells that hold unknowns.
    pub unknowns: usize,
    /// q_lo, q_hi, v_lo, v_hi.
    pub domain: [f64; 4],
    /// Longest step taken; 0 where there is no time.
    pub step: f64,
    /// Steps taken, of all runs together.
    pub steps: u64,
    /// Probability left outside the box by the stationary law or by the start.
    pub neglected: f64,
}

/// What a computation will take, as far as can be said without doing it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost {
    /// Cells in q and v.
    pub cells: [usize; 2],
    /// Steps of the fine run.
    pub steps: u64,
    /// Bytes.
    pub memory: u64,
    /// Seconds on one core.
    pub seconds: f64,
}

/// The neglected probability for a tolerance: a thousandth of it, since fourth moments weigh the tail
/// by (H/T)^2, some hundreds there.
pub(super) fn neglected(tolerance: f64) -> f64 {
    1e-3 * tolerance
}

/// Cells per thermal deviation that reach the tolerance with a scheme of order 8 on the paper's case:
/// 5 for 1e-3, 8.6 for 1e-5 (measured). A lower order gets no more: its error is reported instead.
fn cells_per_deviation(tolerance: f64) -> f64 {
    5.0 * (1e-3 / tolerance).powf(0.118).clamp(0.6, 4.0)
}

/// Width in q over which the stationary law and the force change: half the width of the thermal
/// oscillation, or of its part in contact where the flight is long.
fn thermal_width(oscillator: &Oscillator) -> f64 {
    let contact = oscillator.contact();
    let level = 0.5 * oscillator.temperature();
    let Some((left, right)) = contact.turning_points(level) else {
        return f64::INFINITY;
    };
    let in_contact = contact
        .loss_point()
        .map_or(f64::INFINITY, |loss| right - loss);
    (0.5 * (right - left)).min(0.5 * in_contact.max(right))
}

/// Cells of q and v that the stationary law asks for.
pub(super) fn thermal_widths(oscillator: &Oscillator, tolerance: f64) -> [f64; 2] {
    let per_deviation = cells_per_deviation(tolerance);
    [thermal_width(oscillator), oscillator.temperature().sqrt()].map(|w| w / per_deviation)
}

/// Cells of q and v that a Gaussian start asks for: six tenths of the cells of a thermal deviation are enough
/// where noise smooths the start; 2.5 leave the coarse run, with [`COARSE`] of them and as many in the
/// margins, 1.5.
pub(super) fn start_widths(deviation: [f64; 2], tolerance: f64) -> [f64; 2] {
    deviation.map(|d| d / (0.6 * cells_per_deviation(tolerance)).max(2.5))
}

/// How many times finer than for the stationary law a mesh may be for the sake of its start: beyond, the
/// start is narrow, and a packet in its own frame carries it until it is not. A packet takes 5 ms per
/// unit of time at a tolerance of 1e-3, and refining 1.5 times in both directions doubles the work.
const REFINED: f64 = 1.5;

/// Whether a start is too narrow for the meshes of its run.
pub(super) fn is_narrow(
    oscillator: &Oscillator,
    initial: &Initial,
    drift: Drift,
    settings: &Settings,
) -> Result<bool> {
    let (mean, deviation) = match *initial {
        Initial::Stationary => return Ok(false),
        Initial::Rest => return Ok(true),
        // The box of a law that leaves every box is as narrow as the start.
        Initial::Gaussian { .. } if !oscillator.contact().is_confining() => {
            return Ok(stays_in_frame(oscillator, initial, settings));
        }
        Initial::Gaussian { mean, deviation } => (mean, deviation),
    };
    if settings.cells.is_some() {
        if drift == Drift::Upwind {
            // Exact cell masses hold any start.
            return Ok(false);
        }
        let neglected = neglected(settings.tolerance);
        let domain = Domain::closed(oscillator, initial, neglected)?;
        // Refused in the user's own numbers; and the coarse run has to hold it too.
        mesh_on(oscillator, domain, None, drift, settings, 1.0)?;
        let (mesh, _) = mesh_on(oscillator, domain, None, drift, settings, COARSE)?;
        let width = |axis: &Axis, x: f64| axis.at(axis.locate(x)).1;
        let widths = [width(&mesh.q, mean[0]), width(&mesh.v, mean[1])];
        let narrow = |(d, w): (f64, f64)| d < 1.2 * Density::NARROWEST * w;
        return Ok(deviation.into_iter().zip(widths).any(narrow));
    }
    let thermal = thermal_widths(oscillator, settings.tolerance);
    let start = start_widths(deviation, settings.tolerance);
    Ok(thermal
        .into_iter()
        .zip(start)
        .any(|(thermal, start)| start * REFINED < thermal))
}

/// Whether a run never leaves the frame of its packet, and has no other mesh: a law that leaves every box
/// keeps the shape of a packet for good. A Gaussian start may ask for a box instead.
pub(super) fn stays_in_frame(
    oscillator: &Oscillator,
    initial: &Initial,
    settings: &Settings,
) -> bool {
    let asked = settings.method.is_some()
        || settings.drift.is_some()
        || settings.time.is_some()
        || settings.cells.is_some();
    !oscillator.contact().is_confining()
        && match initial {
            Initial::Rest => true,
            Initial::Gaussian { .. } => !asked,
            Initial::Stationary => false,
        }
}

/// The mesh and its box for a run until `until`; for a narrow start, those without regard to how narrow
/// it is. `finer` times as many cells as chosen, or as the settings give.
///
/// # Errors
/// Those of [`Domain::closed`] and of the axes; [`Error::Mesh`] and [`Error::Invalid`] for cells beyond
/// what can be meant or held.
pub fn mesh(
    oscillator: &Oscillator,
    initial: &Initial,
    until: f64,
    drift: Drift,
    settings: &Settings,
    finer: f64,
) -> Result<(Mesh, Domain)> {
    let neglected = settings
        .neglected
        .unwrap_or_else(|| neglected(settings.tolerance));
    let narrow = is_narrow(oscillator, initial, drift, settings)?;
    let domain = if narrow && oscillator.contact().is_confining() {
        Domain::closed(oscillator, &Initial::Rest, neglected)?.raised(oscillator, initial, until)
    } else if oscillator.contact().is_confining() {
        Domain::closed(oscillator, initial, neglected)?
    } else {
        Domain::swept(oscillator, initial, until, neglected)?
    };
    let start = match *initial {
        Initial::Gaussian { deviation, .. } if !narrow => {
            Some(start_widths(deviation, settings.tolerance))
        }
        _ => None,
    };
    mesh_on(oscillator, domain, start, drift, settings, finer)
}

/// The mesh of a box, with cells no wider than `start` asks for.
pub(super) fn mesh_on(
    oscillator: &Oscillator,
    domain: Domain,
    start: Option<[f64; 2]>,
    drift: Drift,
    settings: &Settings,
    finer: f64,
) -> Result<(Mesh, Domain)> {
    let contact = oscillator.contact();
    let t = oscillator.temperature();
    let mut width = thermal_widths(oscillator, settings.tolerance);
    for (width, start) in width.iter_mut().zip(start.into_iter().flatten()) {
        *width = width.min(start);
    }
    let margin = drift.margin();
    let cells = match settings.cells {
        Some(cells) => cells.map(|n| ((n as f64 * finer) as usize).max(1)),
        None => {
            // Graded axes need fewer cells than their length over the finest one.
            let count = |length: f64, width: f64| (length / width).ceil() + 2.0 * margin as f64;
            let trial = Axis::displacement(contact, t, domain.q, 64 + 2 * margin, margin)?;
            let finest = trial.slopes().iter().copied().fold(f64::INFINITY, f64::min);
            let q = count(64.0 * finest, width[0]) * finer;
            let v = count(domain.v[1] - domain.v[0], width[1]) * finer;
            for (n, axis) in [(q, "q"), (v, "v")] {
                if n > 20_000.0 {
                    return Err(Error::Mesh {
                        what: format!("{n:.1e} cells along {axis} would be needed"),
                        help: "a start that is wider, or nearer to the stationary law".into(),
                    });
                }
            }
            // Even along v: an edge at v = 0 keeps the mesh symmetric.
            [q as usize, 2 * (v / 2.0).ceil() as usize]
        }
    };
    check_memory(cells, drift, settings)?;
    let q = Axis::displacement(contact, t, domain.q, cells[0], margin)?;
    let v = if contact.is_confining() {
        Axis::velocity(domain.v[1], cells[1], margin)?
    } else {
        Axis::uniform(domain.v[0], domain.v[1], cells[1])?
    };
    Ok((Mesh { q, v }, domain))
}

/// What a run factors of the generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Factors {
    /// Nothing.
    None,
    /// A real matrix: steady state, backward Euler.
    Real,
    /// A real and a complex one: Radau IIA.
    Both,
}

impl Factors {
    /// Those of a scheme in time.
    pub fn of(time: TimeScheme) -> Self {
        match time {
            TimeScheme::BackwardEuler => Self::Real,
            TimeScheme::Implicit => Self::Both,
            TimeScheme::Imex | TimeScheme::Explicit => Self::None,
        }
    }
}

/// Bytes of the arrays of a run: a dozen per cell without a matrix; the sparse LU of a five-point
/// stencil holds about 120 entries per unknown, of a wide one about 600 (measured at 1e5 unknowns), each with
/// its place. Radau's steps on large meshes hold that of the five-point stencil and the vectors of GMRES.
pub fn memory(cells: [usize; 2], drift: Drift, factors: Factors) -> u64 {
    const FIVE: u64 = 120;
    const WIDE: u64 = 600;
    const VECTORS: u64 = 42 * 24;
    let (real, complex) = (8 + 8, 16 + 8);
    let count = (cells[0] as u64).saturating_mul(cells[1] as u64);
    let entries = if drift == Drift::Upwind { FIVE } else { WIDE };
    let per_cell = match factors {
        Factors::None => 0,
        Factors::Real => entries * real,
        Factors::Both if count > DIRECT as u64 => FIVE * (real + complex) + VECTORS,
        Factors::Both => entries * (real + complex),
    };
    count.saturating_mul(12 * 8 + per_cell)
}

/// Bytes of the flow map: a dozen arrays and some five maps of 132 bytes per cell; along v, two dense
/// matrices while one is built and some five that are kept.
pub fn flow_map_memory([nq, nv]: [usize; 2]) -> u64 {
    let (nq, nv) = (nq as u64, nv as u64);
    let per_cell = 12 * 8 + 5 * 132;
    nv.saturating_mul(nq.saturating_mul(per_cell).saturating_add(7 * 8 * nv))
}

fn check_memory(cells: [usize; 2], drift: Drift, settings: &Settings) -> Result<()> {
    let factors = settings.time.map_or(Factors::None, Factors::of);
    check_memory_of(memory(cells, drift, factors), cells, settings)
}

/// Refuses a mesh whose generator cannot be factored in the memory allowed.
pub(super) fn check_factors(
    mesh: &Mesh,
    drift: Drift,
    factors: Factors,
    settings: &Settings,
) -> Result<()> {
    let cells = mesh.cells();
    check_memory_of(memory(cells, drift, factors), cells, settings)
}

fn check_memory_of(needed: u64, cells: [usize; 2], settings: &Settings) -> Result<()> {
    if needed <= settings.max_memory {
        return Ok(());
    }
    let gigabytes = |bytes: u64| format!("{:.3} GB", bytes as f64 * 1e-9);
    let accepted = format!(
        "cells that fit accuracy.max_memory = {}; these need about {}",
        gigabytes(settings.max_memory),
        gigabytes(needed)
    );
    Err(Error::invalid(
        "method.cells",
        format!("{cells:?}"),
        accepted,
    ))
}

/// Damping ratio up to which the flow map is taken for all its steps may be. Up to the second, where its
/// errors are known ([`flow_map::Settings::to`]), it is taken if the steps that they ask for are not too short
/// for the cells.
const WEAK: f64 = 0.2;
const KNOWN: f64 = 2.0;

/// Whether the steps that a tolerance asks of the flow map are too short for the cells, and follow them.
pub(super) fn is_strained(
    oscillator: &Oscillator,
    initial: &Initial,
    until: f64,
    settings: &Settings,
) -> Result<bool> {
    if oscillator.zeta() <= WEAK {
        return Ok(false);
    }
    let (mesh, _) = mesh(oscillator, initial, until, Drift::Order8, settings, 1.0)?;
    let step = flow_map_settings(oscillator, settings, 1.0)?.step;
    Ok(oscillator.zeta() > KNOWN || step < FlowMap::shortest_step(oscillator, &mesh))
}

/// The largest bar of a flow map over the loss of contact on five cells per thermal deviation, of order 3 in
/// their number (T = 0.63, zeta = 0.005, a start of half the width of the law at q = 1): as much once, and ten
/// times as much where so many outputs are asked for that some see the moments that are hard.
const KINK: f64 = 1.4e-3;
const OUTPUTS: f64 = 20.0;
/// Probability of flight and damping ratio from which on, and up to which, that is so.
const IN_FLIGHT: f64 = 0.01;
const UNDAMPED: f64 = 0.05;
/// The part of the tolerance aimed at; how many times finer the first cells are made for it at most; and from
/// how many times on finite volumes, which keep the loss of contact on a face, take over.
const KINK_SHARE: f64 = 0.6;
const FINEST: f64 = 3.0;
const TOO_FINE: f64 = 6.0;

/// How many times finer than chosen by the density the cells of the first fine run should be, and those of the last
/// are expected to be. Where finite volumes were taken because of the loss of contact, moments are hard for them
/// too.
pub(super) fn guesses(
    way: Way,
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &Settings,
) -> Result<[f64; 2]> {
    let needed = finer_at_kink(oscillator, initial, times, settings)?;
    Ok(match way {
        Way::FlowMap => [needed.min(FINEST), needed.min(TOO_FINE)],
        Way::Volumes(_) if needed > TOO_FINE => [1.0, 2.0],
        Way::Volumes(_) => [1.0, 1.0],
    })
}

/// How many times finer the cells of a flow map should be because of the loss of contact.
fn finer_at_kink(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &Settings,
) -> Result<f64> {
    let contact = oscillator.contact();
    let (Some(loss), Initial::Gaussian { mean, deviation }) = (contact.loss_point(), initial)
    else {
        return Ok(1.0);
    };
    let free = settings.cells.is_none() && contact.is_confining();
    if !free || is_narrow(oscillator, initial, Drift::Order8, settings)? {
        return Ok(1.0);
    }
    let law = oscillator.displacement_law()?;
    let start = 0.5 * libm::erfc((mean[0] - loss) / (deviation[0] * std::f64::consts::SQRT_2));
    let flight = law.ln_tail_below(loss).value.exp().max(start);
    let seen = 1.0 + 9.0 * (times.len() as f64 / OUTPUTS).min(1.0);
    let weight = seen * (flight / IN_FLIGHT).min(1.0) * (UNDAMPED / oscillator.zeta()).min(1.0);
    let cells = cells_per_deviation(settings.tolerance) / 5.0;
    let needed = (weight * KINK / (KINK_SHARE * settings.tolerance)).cbrt() / cells;
    Ok(needed.max(1.0))
}

/// Method, scheme in space and scheme in time for a transient, with the reason.
pub(super) fn way(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &Settings,
) -> Result<(Drift, Way, String)> {
    if stays_in_frame(oscillator, initial, settings) {
        let reason = "in a law that leaves every box a small mesh moves with the density for good";
        return Ok((Drift::Order8, Way::FlowMap, reason.into()));
    }
    let (drift, way, mut reason) = method(oscillator, initial, times, settings)?;
    if is_narrow(oscillator, initial, drift, settings)? {
        reason += "; the start is too narrow for a mesh, so a small mesh moves with it at first";
    }
    Ok((drift, way, reason))
}

fn method(
    oscillator: &Oscillator,
    initial: &Initial,
    times: &[f64],
    settings: &Settings,
) -> Result<(Drift, Way, String)> {
    let zeta = oscillator.zeta();
    let until = times.last().copied().unwrap_or(0.0);
    let volumes_asked = settings.drift.is_some() || settings.time.is_some();
    let mut beside = "";
    let flow_map = match settings.method {
        Some(TransientMethod::FlowMap) if volumes_asked => {
            let accepted =
                "\"finite_volume\" with method.drift or method.time: the flow map has neither";
            return Err(Error::invalid("method.transient", "\"flow_map\"", accepted));
        }
        Some(TransientMethod::FlowMap) => Some("the scene asks for it".to_string()),
        None if volumes_asked => None,
        None if zeta <= KNOWN
            && finer_at_kink(oscillator, initial, times, settings)? > TOO_FINE =>
        {
            beside = "the loss of contact would take a flow map more than six times the cells along either axis; ";
            None
        }
        None if zeta <= WEAK => Some(format!(
            "zeta = {zeta} <= {WEAK}: weak damping lets the exact motion take long steps"
        )),
        None if zeta <= KNOWN && !is_strained(oscillator, initial, until, settings)? => {
            let step = flow_map_settings(oscillator, settings, 1.0)?.step;
            Some(format!(
                "zeta = {zeta} <= {KNOWN}: the exact motion takes steps of {step:.2}, and the cells allow them"
            ))
        }
        Some(TransientMethod::FiniteVolume) | None => None,
    };
    if let Some(reason) = flow_map {
        return Ok((Drift::Order8, Way::FlowMap, reason));
    }
    let (drift, why_drift) = drift(settings)?;
    let (time, why_time) = match settings.time {
        Some(time) => (time, "the scene asks for this scheme in time".to_string()),
        None => {
            let on = |finer: f64| {
                let (mesh, _) = mesh(oscillator, initial, until, drift, settings, finer)?;
                Generator::new(oscillator, &mesh, drift)
            };
            let generator = finer_until_held(settings, 1.0, on)?.1;
            time_scheme(oscillator, &generator, settings, until)
        }
    };
    Ok((
        drift,
        Way::Volumes(time),
        format!("{beside}{why_drift}; {why_time}"),
    ))
}

/// How many times finer than the first guess cells are tried before a scene is refused.
const MOST_FINER: f64 = 1.9;

/// What `on` makes of cells `finer` times as fine as the first guess, or finer where those do not hold the scene and
/// are not the scene's own; and how fine they were.
pub(super) fn finer_until_held<T>(
    settings: &Settings,
    finer: f64,
    on: impl Fn(f64) -> Result<T>,
) -> Result<(f64, T)> {
    let mut finer = finer;
    loop {
        match on(finer) {
            Err(Error::Mesh { .. }) if settings.cells.is_none() && finer < MOST_FINER => {
                finer *= 1.25;
            }
            it => return Ok((finer, it?)),
        }
    }
}

/// The propagator of a way on a mesh, its steps `longer` times as long as the tolerance asks.
pub(super) fn propagator(
    oscillator: &Oscillator,
    mesh: &Mesh,
    drift: Drift,
    way: Way,
    settings: &Settings,
    until: f64,
    longer: f64,
) -> Result<Propagator> {
    match way {
        Way::FlowMap => {
            check_memory_of(flow_map_memory(mesh.cells()), mesh.cells(), settings)?;
            let mut automatic = flow_map_settings(oscillator, settings, longer)?;
            let shortest = FlowMap::shortest_step(oscillator, mesh);
            if settings.step.is_some() && automatic.step < shortest {
                let accepted = format!(
                    "at least {shortest:.2e} for the flow map on this mesh: shorter steps let grid noise grow"
                );
                return Err(Error::invalid("method.step", automatic.step, accepted));
            }
            automatic.step = automatic.step.max(shortest);
            Propagator::flow_map(oscillator, mesh, automatic)
        }
        Way::Volumes(time) => {
            let generator = Generator::new(oscillator, mesh, drift)?;
            let timed = Settings {
                tolerance: time_share(time) * settings.tolerance * longer.powi(STEP_ORDER),
                step: match (time, settings.step) {
                    (TimeScheme::BackwardEuler, None) => {
                        Some(longer * euler_step(&generator, settings))
                    }
                    (_, step) => step.map(|step| longer * step),
                },
                ..settings.clone()
            };
            let march = march(oscillator, &generator, time, &timed, until);
            Ok(Propagator::Volumes {
                generator: Box::new(generator),
                march,
            })
        }
    }
}

/// The steps of the flow map, `longer` times as long as the tolerance asks.
pub(super) fn flow_map_settings(
    oscillator: &Oscillator,
    settings: &Settings,
    longer: f64,
) -> Result<flow_map::Settings> {
    if let Some(step) = settings.step {
        positive("method.step", step)?;
    }
    // The splitting gets a fourteenth of the tolerance: two runs see little of it, and it has a part of its own in the bar.
    let automatic = flow_map::Settings::to(0.07 * settings.tolerance, oscillator)?;
    // Beyond the longest useful step the error is not known, and two runs would not show it.
    let asked = settings.step.unwrap_or(automatic.step);
    let step = longer * asked.min(flow_map::Settings::LONGEST);
    Ok(flow_map::Settings { step, ..automatic })
}

/// Scheme in space, with the reason.
fn drift(settings: &Settings) -> Result<(Drift, String)> {
    if let Some(step) = settings.step {
        positive("method.step", step)?;
    }
    Ok(match settings.drift {
        Some(drift) => (drift, "the scene asks for this drift".to_string()),
        None if settings.time == Some(TimeScheme::BackwardEuler) => (
            Drift::Upwind,
            "backward Euler is positive with upwind drift only".to_string(),
        ),
        None => (
            Drift::Order8,
            "order 8: fewest cells for a smooth density".to_string(),
        ),
    })
}

/// The numerical diffusion of upwind drift against the physical one: energy relaxes 1 + c times too
/// fast, c = 0.4 (dq + dv)/(2 zeta sigma) for cells dq, dv at equilibrium, sigma = sqrt(T).
pub fn upwind_excess(oscillator: &Oscillator, mesh: &Mesh) -> f64 {
    let width = |axis: &Axis, x: f64| axis.at(axis.locate(x)).1;
    let cells = width(&mesh.q, 0.0) + width(&mesh.v, 0.0);
    0.4 * cells / (2.0 * oscillator.zeta() * oscillator.temperature().sqrt())
}

/// Part of a transient's tolerance that the errors of the steps may add up to in the L1 norm: the mesh
/// and the box have the rest.
const TIME_SHARE: f64 = 0.1;

/// The same where accuracy costs next to nothing: a Chebyshev series gains a digit for a stage or two.
pub(super) const SERIES_SHARE: f64 = 1e-3;

fn time_share(time: TimeScheme) -> f64 {
    match time {
        TimeScheme::Explicit => SERIES_SHARE,
        _ => TIME_SHARE,
    }
}

/// Steps that choose themselves are lengthened by raising the error they may make: about the power with
/// which it goes with the step.
const STEP_ORDER: i32 = 3;

/// Time over which errors add up before the oscillator forgets them.
fn horizon(oscillator: &Oscillator, until: f64) -> f64 {
    until.min(0.5 / oscillator.zeta() + 2.0 * oscillator.zeta())
}

/// The step of backward Euler: first order in time beside first order in space, one cell a step at a
/// third of the fastest speed.
pub(super) fn euler_step(generator: &Generator, settings: &Settings) -> f64 {
    settings
        .step
        .unwrap_or_else(|| euler_step_on(generator.mesh()))
}

/// The automatic step of backward Euler on a mesh.
pub(super) fn euler_step_on(mesh: &Mesh) -> f64 {
    let width = mesh.q.at(mesh.q.locate(0.0)).1;
    3.0 * width / mesh.v.edges()[mesh.v.len()].abs().max(f64::MIN_POSITIVE)
}

/// The scheme with its choice of steps for a run until `until`, such that the error in time stays below
/// `settings.tolerance` in the L1 norm; a tenth to a half of it is measured where accuracy bounds many
/// steps, a hundredth of it in a few implicit ones, and less where stability bounds them (tests/time.rs).
pub fn march(
    oscillator: &Oscillator,
    generator: &Generator,
    time: TimeScheme,
    settings: &Settings,
    until: f64,
) -> March {
    let choice = if time == TimeScheme::BackwardEuler {
        Step::Fixed(euler_step(generator, settings))
    } else {
        // Steps longer than the motion's memory resolve nothing, and the systems of implicit ones grow hard to solve.
        let memory = oscillator.memory();
        let longest = settings.step.unwrap_or(memory);
        // Two runs that begin with the same steps would not see what these do.
        let shorter = (settings.tolerance / 1e-3).cbrt().clamp(0.1, 1.0);
        Step::Error {
            total: settings.tolerance,
            horizon: horizon(oscillator, until),
            first: longest.min(shorter * 0.1 / (1.0 + 2.0 * oscillator.zeta())),
            longest,
        }
    };
    let scheme: Box<dyn Integrator> = match time {
        TimeScheme::BackwardEuler => Box::new(BackwardEuler::new(generator)),
        TimeScheme::Implicit => Box::new(Radau::new(generator, solver(generator))),
        TimeScheme::Imex => Box::new(Additive::new(generator)),
        TimeScheme::Explicit => Box::new(Chebyshev::new(generator)),
    };
    March::new(scheme, choice)
}

/// Unknowns above which GMRES with the LU of the five-point operator beats the LU of the wide stencil.
/// Order 8, T = 0.63, seconds of a factorisation and of a step (benches/time.rs; a run of a hundred steps
/// factors about ten times):
///
/// | unknowns | LU | GMRES |
/// |---|---|---|
/// | 2091 | 0.08, 0.0015 to 0.003 | 0.01, 0.003 to 0.010 (7 to 23 iterations) |
/// | 4617 | 0.28, 0.007 to 0.011 | 0.03, 0.005 to 0.024 (7 to 24) |
/// | 9471 | 0.75, 0.017 | 0.08, 0.012 to 0.057 (7 to 30) |
const DIRECT: usize = 2000;

/// How the systems of an implicit scheme are solved.
fn solver(generator: &Generator) -> Solver {
    if generator.unknowns() < DIRECT {
        Solver::Direct
    } else {
        Solver::Krylov
    }
}

/// The scheme in time that costs least on this mesh, with the reason. Costs are counted in stages of the
/// explicit scheme, 7 ns a cell at order 8; the measurements are those of tests/time.rs.
pub fn time_scheme(
    oscillator: &Oscillator,
    generator: &Generator,
    settings: &Settings,
    until: f64,
) -> (TimeScheme, String) {
    if generator.drift() == Drift::Upwind {
        let reason = "backward Euler keeps upwind drift positive";
        return (TimeScheme::BackwardEuler, reason.into());
    }
    let (transport, diffusion) = generator.radii();
    // 1.2 stages per unit of F dt + s dt at the longest step, up to twice that in a tall box.
    let tall = 1.0 + (0.1 * diffusion / transport).min(1.0);
    let explicit = 1.2 * (transport + 0.5 * diffusion * tall) * until;
    // A step costs 18 stages (119 ns a cell); bound by transport, and while the start is smoothed by accuracy:
    // 15 steps per unit of time at 1e-5, order 4.
    let accuracy = 15.0 * (1e-5 / settings.tolerance).powf(0.25);
    let bound = transport / 3.8;
    let imex = 18.0 * (until * bound + until.min(5.0) * (accuracy - bound).max(0.0) + 50.0);
    // A step costs 250 stages, a factorisation 800. About 60 steps and ten factorisations until the
    // step is that of the slow motion: 0.1 of its time 1 or 2 zeta at 1e-5, order 5.
    let finer = (1e-5 / settings.tolerance).powf(0.2);
    let slow = 0.1 * (2.0 * oscillator.zeta()).max(1.0) / finer;
    let implicit = 250.0 * (60.0 * finer + until / slow) + 8000.0;
    let costs = [
        (TimeScheme::Explicit, explicit),
        (TimeScheme::Imex, imex),
        (TimeScheme::Implicit, implicit),
    ];
    let (best, _) = costs.iter().fold(
        costs[0],
        |best, other| if other.1 < best.1 { *other } else { best },
    );
    let reason = format!(
        "{}: transport at a rate of {transport:.0}, friction and diffusion of {diffusion:.0} and steps of \
         {slow:.1e} for accuracy cost about {explicit:.1e} stages explicit, {imex:.1e} imex, \
         {implicit:.1e} implicit",
        best.name()
    );
    (best, reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scheme_is_known_by_its_name_and_by_no_other() {
        for scheme in TimeScheme::ALL {
            assert_eq!(TimeScheme::parse(scheme.name()).unwrap(), scheme);
        }
        let message = TimeScheme::parse("euler").unwrap_err().to_string();
        assert!(message.contains("\"imex\""), "{message}");
    }
}
