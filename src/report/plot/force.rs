//! The density of the force, linear and logarithmic, with its Dirac mass.

use super::canvas::{
    Area, BLUE, Drawn, INK, NOTE, Picture, Points, VERMILION, line, picture, write,
};
use super::density::Sheet;
use super::legend::{Mark, legends};
use super::panel::{Panel, range};
use crate::estimate::Estimate;
use crate::format::brief;
use crate::moments::Moment;
use crate::monte_carlo::Histogram;
use crate::results::Results;

/// The part of the mean stiffness below which p_N = p_q/G' is near a singularity.
const SOFT: f64 = 0.3;

/// What force.svg shows.
struct ForceCurves {
    /// (N, p_N) of the stationary law, and of the mesh.
    exact: Points,
    meshed: Points,
    /// What the mesh's points are.
    words: String,
    /// Where the law comes from.
    origin: &'static str,
    /// Histogram of long realisations.
    sampled: Option<Histogram>,
    /// The Dirac mass and the force of flight it stands at, if that is within the picture; its mass in long realisations.
    dirac: Option<(Estimate, f64)>,
    sampled_dirac: Option<Estimate>,
    /// Largest density away from the singularities where the contact has no stiffness.
    most: f64,
}

impl ForceCurves {
    fn of(results: &Results) -> Option<Self> {
        let law = results.law()?;
        let contact = results.contact();
        let t = results.scene.oscillator.temperature();
        let (low, high) = contact.turning_points(14.0 * t)?;
        let loss = contact.loss_point();
        let walled = contact.back_wall().is_some();
        let from = loss.filter(|_| !walled).map_or(low, |loss| loss.max(low));
        // Squares crowd the points where the density is steep, near the loss of contact.
        let squares = (1..=600).map(|k| from + (high - from) * (f64::from(k) / 600.0).powi(2));
        let held = squares.filter(|q| !walled || !contact.is_lost(*q));
        let mut forces: Vec<f64> = held.map(|q| contact.force(q)).collect();
        forces.sort_by(f64::total_cmp);
        let exact: Points = forces
            .into_iter()
            .map(|force| (force, law.density_force(force)))
            .filter(|(_, p)| p.is_finite())
            .collect();
        let (snapshot, words) = match (&results.steady, &results.transient) {
            (Some(it), _) => (Some(&it.density), "steady state on the mesh".to_owned()),
            (None, Some(it)) => {
                let last = it.densities.last();
                let t = last.map_or(String::new(), |it| brief(it.t));
                let unit = results.scene.clock().suffix();
                (last, format!("on the mesh, t = {t}{unit}"))
            }
            _ => (None, String::new()),
        };
        let sheet = snapshot.and_then(Sheet::of);
        let meshed = sheet
            .iter()
            .flat_map(|sheet| sheet.q.iter().zip(&sheet.p_q))
            .filter(|(q, _)| !contact.is_lost(**q) && loss != Some(**q))
            // Where one force has several places, none of them has its density.
            .filter(|(q, _)| contact.displacements_at(contact.force(**q)).len() == 1)
            .map(|(q, p)| (contact.force(*q), p / contact.stiffness(*q)))
            .collect();
        let flight = loss.filter(|it| *it >= low).map(|it| contact.force(it));
        let stiff = |n: f64| {
            let all = contact.displacements_at(n).into_iter();
            all.map(|q| contact.stiffness(q).abs())
                .fold(f64::INFINITY, f64::min)
        };
        let usual = results.scene.oscillator.displacement_law().ok()?;
        let usual = usual.expect(|q| contact.stiffness(q).abs()).value;
        let near = exact.iter().filter(|(n, _)| stiff(*n) > SOFT * usual);
        let most = near.map(|(_, p)| *p).fold(0.0, f64::max);
        Some(Self {
            dirac: law.contact_loss_probability().zip(flight),
            origin: law.words(),
            exact,
            meshed,
            words,
            sampled: results.records.as_ref().map(|it| it.force.clone()),
            sampled_dirac: results
                .sampled_stationary()
                .and_then(|it| it.get(Moment::ContactLossProbability.name())),
            most,
        })
    }

    fn draw(&self, area: &Area<'_>, panel: &Panel) -> Drawn {
        panel.axes(area, "N", "p(N)")?;
        let scaled = |points: &Points| -> Points {
            let height = |p: f64| if panel.log { p.max(1e-300).log10() } else { p };
            points.iter().map(|(n, p)| (*n, height(*p))).collect()
        };
        // Dots at least four pixels apart.
        let mut last = f64::NEG_INFINITY;
        for (n, p) in scaled(&self.meshed) {
            let (px, _) = panel.at(n, p);
            if px - last >= 4.0 {
                panel.dot(area, (n, p), BLUE, 2.5)?;
                last = px;
            }
        }
        if let Some(it) = &self.sampled {
            panel.histogram(area, it)?;
        }
        panel.curve(area, &scaled(&self.exact), INK, 1.5)?;
        if let Some((mass, flight)) = self.dirac {
            let (x, _) = panel.at(flight, panel.y.0);
            let tip = panel.top + 12.0;
            line(area, &[(x, panel.bottom()), (x, tip)], VERMILION, 2.5)?;
            let head = [(x - 4.5, tip + 9.0), (x, tip), (x + 4.5, tip + 9.0)];
            line(area, &head, VERMILION, 2.5)?;
            let words = format!("Dirac mass P(N = {flight}) = {}", probability(mass));
            let words = words.replace('-', "\u{2212}");
            write(area, &words, (x + 11.0, tip + 4.0), NOTE)?;
            if let Some(mass) = self.sampled_dirac.filter(|it| it.value.is_finite()) {
                let words = format!("records: {} \u{b1} {:.0e}", probability(mass), mass.error);
                let words = words.replace("e-", "e\u{2212}");
                let at = (x + 11.0, tip + 22.0);
                write(area, &words, at, NOTE)?;
            }
        }
        panel.frame(area)
    }
}

/// force.svg: p_N on a linear and a logarithmic scale, the Dirac mass drawn and stated.
pub(crate) fn force(results: &Results) -> Picture {
    let curves = ForceCurves::of(results).filter(|it| it.most > 0.0)?;
    let seen = curves.exact.iter().filter(|(_, p)| *p > 1e-5 * curves.most);
    let flight = curves.dirac.map(|it| it.1);
    let x = range(seen.map(|it| it.0).chain(flight), 0.05)?;
    let linear = Panel::new([92.0, 44.0, 390.0, 320.0], x, (0.0, 1.3 * curves.most));
    let top = curves.most.log10();
    let logarithmic = Panel {
        left: 578.0,
        y: (top - 5.0, top + 0.8),
        log: true,
        ..linear.clone()
    };
    let law = results.stationary.as_ref();
    let far = law.and_then(|it| it.get("log10_contact_loss_probability"));
    Some(picture("force.svg", (990, 420), |area| {
        let plain = results.scene.excitation.is_plain();
        let noise = if plain { "" } else { ", steady noise alone" };
        linear.title(area, &format!("Force: stationary density p(N){noise}"))?;
        curves.draw(area, &linear)?;
        curves.draw(area, &logarithmic)?;
        if let Some(far) = far.filter(|_| curves.dirac.is_none()) {
            let words = format!(
                "Dirac mass, left of this picture: log\u{2081}\u{2080} P = {:.1}",
                far.value
            );
            let words = words.replace('-', "\u{2212}");
            write(area, &words, (logarithmic.left, 24.0), NOTE)?;
        }
        let mut entries = vec![(INK, Mark::Line, curves.origin)];
        if !curves.meshed.is_empty() {
            entries.push((BLUE, Mark::Dot, &curves.words));
        }
        if curves.sampled.is_some() {
            entries.push((VERMILION, Mark::Dot, "long realisations, band: 95 %"));
        }
        // Below what is said of the Dirac mass.
        let top = match (curves.dirac, &curves.sampled) {
            (None, _) => 62.0,
            (Some(_), None) => 82.0,
            (Some(_), Some(_)) => 101.0,
        };
        legends(area, (linear.right() - 226.0, top), entries)
    }))
}

fn probability(mass: Estimate) -> String {
    if mass.value == 0.0 {
        "0 (underflows)".into()
    } else if mass.value < 1e-3 {
        format!("{:.3e}", mass.value)
    } else {
        format!("{:.4}", mass.value)
    }
}
