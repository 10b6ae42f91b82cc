//! What errors are measured against: a closed form, or fine runs of two methods, each of which judges the
//! other.

use super::case::Case;
use super::method::{Level, Method};
use super::solve::{Answer, solve};
use vibroimpact::contact::ContactLaw;
use vibroimpact::error::Result;
use vibroimpact::fokker_planck::difference::lagrange;
use vibroimpact::fokker_planck::flow_map::Splitting;
use vibroimpact::fokker_planck::{Density, Drift, TimeScheme};
use vibroimpact::gaussian::Gaussian;
use vibroimpact::moments::Moments;

/// The numbers whose errors are shown.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Numbers {
    pub(super) square_speed: f64,
    pub(super) energy: f64,
    pub(super) loss: Option<f64>,
}

impl Numbers {
    pub(super) fn of(moments: &Moments) -> Self {
        Self {
            square_speed: moments.var_v.value + moments.mean_v.value.powi(2),
            energy: moments.mean_energy.value,
            loss: moments.contact_loss_probability.map(|it| it.value),
        }
    }
}

/// Errors of a run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Errors {
    /// Of the density in the L1 norm; None for paths.
    pub l1: Option<f64>,
    /// Of E\[v^2\], over T.
    pub square_speed: f64,
    /// Of E\[H\], over T.
    pub energy: f64,
    /// Of P(q < q_loss); None for a law that cannot lose contact.
    pub loss: Option<f64>,
    /// Energy exchanged with the bath by the numbers beyond what physics exchanges, over the latter:
    /// numerical over physical diffusion and friction.
    pub diffusion: f64,
}

/// A density to compare with.
enum Shape {
    Exact(Gaussian),
    Fine(Box<Density>),
}

struct Answers {
    shape: Shape,
    numbers: Numbers,
}

/// What a case is measured against.
pub struct Reference {
    temperature: f64,
    start_energy: f64,
    /// The closed form, or the fine run of the flow map; of a stiff case finite volumes of order 6.
    first: Answers,
    /// The method of that run, and the fine run of finite volumes of order 8 that judges its kind.
    second: Option<(Method, Answers)>,
}

/// The fine runs: a decade beyond the finest level shown, some seconds each.
const FINE: Level = Level {
    finer: 2.8,
    tolerance: 1e-7,
    paths: 0,
};

impl Reference {
    /// The closed form of a case, or two fine runs.
    pub fn of(case: &Case) -> Result<Self> {
        Self::at(case, &FINE)
    }

    /// With runs of another fineness.
    pub fn at(case: &Case, fine: &Level) -> Result<Self> {
        let temperature = case.oscillator.temperature();
        if case.is_closed_form() {
            let start = Gaussian::of(&case.oscillator, &case.initial)?;
            let end = start.after(&case.oscillator, case.until)?;
            return Ok(Self {
                temperature,
                start_energy: closed_form(case, &start).energy,
                first: Answers {
                    shape: Shape::Exact(end),
                    numbers: closed_form(case, &end),
                },
                second: None,
            });
        }
        let flow_map = Method::FlowMap {
            splitting: Splitting::EvenFive,
        };
        let volumes = |drift, time| Method::Volumes { drift, time };
        // Under strong damping steps of the explicit scheme shrink as the square of the cells, and those of
        // the flow map as its tolerance: there finite volumes of two orders, with two integrators, judge each
        // other, and the flow map.
        let stiff = case.is_stiff();
        let (one, other) = if stiff {
            (
                volumes(Drift::Order6, TimeScheme::Implicit),
                volumes(Drift::Order8, TimeScheme::Imex),
            )
        } else {
            (flow_map, volumes(Drift::Order8, TimeScheme::Explicit))
        };
        // A step of the implicit scheme on all the cells takes a second.
        let coarser = Level {
            finer: if stiff { 0.7 } else { 1.0 } * fine.finer,
            ..*fine
        };
        let start = Case {
            until: 0.0,
            ..case.clone()
        };
        let start_energy = Numbers::of(&solve(&start, flow_map, fine, 0)?.moments).energy;
        let answers = |it: Answer| -> Option<Answers> {
            let numbers = Numbers::of(&it.moments);
            Some(Answers {
                shape: Shape::Fine(Box::new(it.density?)),
                numbers,
            })
        };
        // Far above the preload flights are long and the contact is stiff beside them: with 0.6 of the cells
        // finite volumes take half a minute, with all of them two.
        let loud = case.oscillator.temperature() > 10.0;
        let fewer = Level {
            finer: if loud { 0.6 } else { 1.0 } * fine.finer,
            ..*fine
        };
        let second = answers(solve(case, other, &fewer, 0)?).map(|it| (one, it));
        let Some(first) = answers(solve(case, one, &coarser, 0)?) else {
            unreachable!("all but paths answer with a density")
        };
        Ok(Self {
            temperature,
            start_energy,
            first,
            second,
        })
    }

    /// The errors of an answer, judged by another method than its own.
    pub(super) fn errors(&self, method: Method, answer: &Answer) -> Errors {
        let judge = match &self.second {
            Some((own, second)) if own.is_same_family(method) => second,
            _ => &self.first,
        };
        self.against(judge, answer)
    }

    /// The distance between the two references; what the closed form is known to if there is one.
    pub fn uncertainty(&self) -> Errors {
        let (Some((_, second)), Shape::Fine(density)) = (&self.second, &self.first.shape) else {
            return Errors {
                l1: Some(0.0),
                ..Errors::default()
            };
        };
        let l1 = l1(&second.shape, density);
        self.numbers(second, &self.first.numbers, Some(l1))
    }

    fn against(&self, judge: &Answers, answer: &Answer) -> Errors {
        let l1 = answer.density.as_ref().map(|it| l1(&judge.shape, it));
        self.numbers(judge, &Numbers::of(&answer.moments), l1)
    }

    fn numbers(&self, judge: &Answers, numbers: &Numbers, l1: Option<f64>) -> Errors {
        let expected = &judge.numbers;
        let energy = numbers.energy - expected.energy;
        Errors {
            l1,
            square_speed: (numbers.square_speed - expected.square_speed).abs() / self.temperature,
            energy: energy.abs() / self.temperature,
            loss: numbers.loss.zip(expected.loss).map(|(a, b)| (a - b).abs()),
            diffusion: energy / (expected.energy - self.start_energy),
        }
    }
}

fn closed_form(case: &Case, law: &Gaussian) -> Numbers {
    let square = |k: usize| law.covariance[k][k] + law.mean[k].powi(2);
    let potential = match case.oscillator.contact() {
        ContactLaw::Linear => 0.5 * square(0),
        _ => -law.mean[0],
    };
    Numbers {
        square_speed: square(1),
        energy: 0.5 * square(1) + potential,
        loss: None,
    }
}

/// The L1 distance of a density to a reference, at the cell centres; beyond its truncated domain it is 0.
fn l1(reference: &Shape, density: &Density) -> f64 {
    let mesh = density.mesh();
    let (q, v) = (&mesh.q, &mesh.v);
    let n = v.len();
    let cells = density.cells();
    let area = |i: usize, j: usize| q.slopes()[i] * v.slopes()[j];
    match reference {
        Shape::Exact(law) => (0..q.len())
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .map(|(i, j)| {
                let exact = law.density(q.centres()[i], v.centres()[j]) * area(i, j);
                (cells[i * n + j] - exact).abs()
            })
            .sum(),
        Shape::Fine(fine) => {
            let rows: Vec<_> = q
                .centres()
                .iter()
                .map(|x| stencil(&fine.mesh().q, *x))
                .collect();
            let columns: Vec<_> = v
                .centres()
                .iter()
                .map(|x| stencil(&fine.mesh().v, *x))
                .collect();
            let (fq, fv) = (fine.mesh().q.slopes(), fine.mesh().v.slopes());
            let m = fv.len();
            let p = |a: usize, b: usize| fine.cells()[a * m + b] / (fq[a] * fv[b]);
            let mut sum = 0.0;
            for (i, row) in rows.iter().enumerate() {
                for (j, column) in columns.iter().enumerate() {
                    let exact = match (row, column) {
                        (Some((a, x)), Some((b, y))) => x
                            .iter()
                            .enumerate()
                            .map(|(r, x)| {
                                let inner = y.iter().enumerate().map(|(s, y)| y * p(a + r, b + s));
                                x * inner.sum::<f64>()
                            })
                            .sum(),
                        _ => 0.0,
                    };
                    sum += (cells[i * n + j] - exact * area(i, j)).abs();
                }
            }
            sum
        }
    }
}

/// Points of the interpolation between the cells of a fine run.
const POINTS: usize = 8;

/// First cell and weights that interpolate at x; None outside the axis.
fn stencil(axis: &vibroimpact::fokker_planck::Axis, x: f64) -> Option<(usize, [f64; POINTS])> {
    let xi = axis.locate(x);
    let n = axis.len();
    if !(xi >= 0.0 && xi <= n as f64) || n < POINTS {
        return None;
    }
    let first =
        ((xi - 0.5).floor() as isize - (POINTS as isize / 2 - 1)).clamp(0, (n - POINTS) as isize);
    let mut weights = [0.0; POINTS];
    lagrange(first as f64 + 0.5, xi, &mut weights);
    Some((first as usize, weights))
}
