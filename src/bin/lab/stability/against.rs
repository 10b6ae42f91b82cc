//! What a scene's numbers may be held against.

use std::fmt;
use toml::Value;

/// What a scene's numbers are held against.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Against {
    /// The closed-form transient of G = q or G = -1: a Gaussian stays one.
    Gaussian,
    /// The closed form of free flight, for a start that stays out of contact.
    Flight,
    /// The stationary law (21): for a stationary start, or after a long time.
    Stationary,
    /// The moments of the Gaussian start itself: for times that are nearly 0.
    Start,
    /// The scene's own ensemble of paths.
    Paths,
    /// The same scene with these overrides: finer, or by another method; what is sampled against what is sampled.
    Other(Vec<String>),
    /// d/dt E\[H\] = pi h - 2 zeta E\[v^2\], integrated over equal output intervals.
    EnergyLaw,
    /// log10 P(q < q_loss) of the Hertz law: T e^{-9/(10 T)} over the normaliser by the trapezoidal rule.
    FlightTail,
    /// The decay rates of G = q: -zeta (m + n) + i sqrt(1 - zeta^2) (m - n).
    LinearRates,
    /// The steady state on the mesh against (21).
    Steady,
    Refusal,
}

/// The word of each in the scenes, and the words for it in the tables.
const WORDS: [(&str, Against, &str); 10] = [
    ("gaussian", Against::Gaussian, "closed form"),
    ("flight", Against::Flight, "closed form of flight"),
    ("stationary", Against::Stationary, "stationary law"),
    ("start", Against::Start, "the start"),
    ("paths", Against::Paths, "Monte Carlo"),
    ("energy law", Against::EnergyLaw, "energy law"),
    ("flight tail", Against::FlightTail, "tail in closed form"),
    ("linear rates", Against::LinearRates, "closed form"),
    ("steady state", Against::Steady, "stationary law"),
    ("refusal", Against::Refusal, "to be refused"),
];

impl Against {
    /// From an entry of the scenes; what is accepted instead, if it is none.
    pub fn read(value: Option<&Value>) -> Result<Self, String> {
        let overrides =
            value.and_then(|it| it.get("other")?.as_array()?.iter().map(text).collect());
        let word = value.and_then(Value::as_str);
        let simple = WORDS.iter().find(|it| Some(it.0) == word);
        let accepted = || {
            let words = WORDS.map(|it| it.0).join(", ");
            format!("{words} or {{ other = [overrides] }}")
        };
        overrides
            .map(Self::Other)
            .or(simple.map(|it| it.1.clone()))
            .ok_or_else(accepted)
    }
}

fn text(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}

impl fmt::Display for Against {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Other(overrides) => f.write_str(&overrides.join(", ")),
            simple => {
                let words = WORDS.iter().find(|it| it.1 == *simple);
                f.write_str(words.map_or("", |it| it.2))
            }
        }
    }
}
