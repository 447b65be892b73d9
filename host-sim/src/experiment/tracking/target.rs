//! What the figures of the scenarios are to reach: what they must, and what is aimed at.

use super::figures::Figures;

/// A figure to reach.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// The scenario.
    pub scenario: &'static str,
    /// What is measured, with its unit.
    pub figure: &'static str,
    /// The measured value; none where it is unknown.
    pub measured: fn(&Figures) -> Option<f64>,
    /// Least and largest that it must be.
    pub must: [f64; 2],
    /// Least and largest that is aimed at.
    pub aim: [f64; 2],
}

const fn at_most(
    scenario: &'static str,
    figure: &'static str,
    measured: fn(&Figures) -> Option<f64>,
    [must, aim]: [f64; 2],
) -> Target {
    Target { scenario, figure, measured, must: [0.0, must], aim: [0.0, aim] }
}

const fn honest(scenario: &'static str) -> Target {
    let measured: fn(&Figures) -> Option<f64> = |figures| figures.nees;
    Target { scenario, figure: "NEES per dof", measured, must: [0.7, 1.4], aim: [0.9, 1.1] }
}

const fn none_diverges(scenario: &'static str) -> Target {
    at_most(scenario, "runs diverged", |figures| Some(figures.diverged.len() as f64), [0.0, 0.0])
}

/// All of them.
pub const TARGETS: &[Target] = &[
    at_most("slam", "RMSE m", |figures| figures.rmse_m, [0.08, 0.05]),
    at_most("slam", "worst run's 95 % error m", |figures| figures.p95_worst_m, [0.25, 0.12]),
    none_diverges("slam"),
    at_most("slam", "map OSPA m", |figures| figures.ospa_m, [0.5, 0.2]),
    at_most("slam", "us per cycle", |figures| Some(figures.us_per_cycle), [200.0, 50.0]),
    honest("slam"),
    none_diverges("slam-clutter"),
    none_diverges("slam-detection"),
    none_diverges("slam-frames-lost"),
    none_diverges("slam-gap"),
    none_diverges("slam-long-gap"),
    at_most("known-plan", "RMSE / posterior CRLB", |figures| figures.rmse_over_posterior_crlb, [1.5, 1.15]),
    none_diverges("known-plan"),
    honest("known-plan"),
    at_most("layered-walls", "RMSE m", |figures| figures.rmse_m, [0.03, 0.015]),
    none_diverges("layered-walls"),
    at_most("one-anchor", "RMSE m", |figures| figures.rmse_m, [0.10, 0.05]),
    none_diverges("one-anchor"),
    none_diverges("plan-walls-off"),
    none_diverges("plan-wall-missing"),
    none_diverges("plan-wall-added"),
    none_diverges("frames-lost"),
    none_diverges("gap"),
    none_diverges("whole-room-start"),
];

/// How a value stands to a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Within what is aimed at.
    Aim,
    /// Within what it must be.
    Must,
    /// Neither.
    Missed,
}

impl Target {
    /// How the scenario's figures stand to it; none where nothing was measured.
    pub fn verdict(&self, figures: &Figures) -> Option<Verdict> {
        let value = (self.measured)(figures)?;
        let within = |[least, most]: [f64; 2]| value >= least && value <= most;
        Some(if within(self.aim) {
            Verdict::Aim
        } else if within(self.must) {
            Verdict::Must
        } else {
            Verdict::Missed
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_aimed_at_is_within_what_must_be_and_nan_misses() {
        for target in TARGETS {
            assert!(target.must[0] <= target.aim[0] && target.aim[1] <= target.must[1], "{}", target.figure);
        }
        let nees = honest("slam");
        let none = Figures::new("slam", crate::replay::TrackerVariant::default(), &[]);
        let verdict = |nees_value| nees.verdict(&Figures { nees: nees_value, ..none.clone() });
        assert_eq!(verdict(Some(1.0)), Some(Verdict::Aim));
        assert_eq!(verdict(Some(0.8)), Some(Verdict::Must));
        assert_eq!(verdict(Some(0.14)), Some(Verdict::Missed));
        assert_eq!(verdict(Some(f64::NAN)), Some(Verdict::Missed));
        assert_eq!(verdict(None), None);
    }
}
