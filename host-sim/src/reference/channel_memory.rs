//! Channel memory: how well each source (direct path or virtual anchor) is heard with each action.
//!
//! Of the distance-compensated energies e = |alpha|^2 d^2 it keeps a count n and two moments, with a window of 40
//! samples: n <- n (1 - share/40) + share, and likewise for sum e and sum e^2. A sample at one carrier counts at
//! another by share = weight rho^4, rho the overlap of the two spectra. The method of moments gives
//!
//! SINR = A / (m1 - A), A = sqrt(m1^2 - var).
//!
//! While samples are few, a forgetting mean of the channel estimator's ln SINR takes its place; twice that mean bounds
//! it later. A source that was expected in a frame and missed enters as a sample without energy.

use super::association::Measurement;
use super::controller::Library;
use super::real::{Real, exp, larger, limited, ln, smaller, sqrt, square};
use cogmint_core::perceptor::state_filter::Source;
use std::fmt;

const WINDOW: f32 = 40.0;
const AGEING: f32 = 0.999;
const INSTANT_FORGETTING: f32 = 0.2;
const TRUSTED: f32 = 8.0;
/// The moments are believed up to this multiple of the estimator's SINR.
const OPTIMISM: f32 = 2.0;
/// SINR that a miss stands for.
const MISSED_SINR: f32 = 0.5;
const REFERENCE_FLOOR: f32 = 1e-30;

/// One source at one action.
#[derive(Clone, Copy, Debug)]
pub struct Moments<T> {
    /// Effective number of samples.
    pub count: T,
    /// Sum of relative energies.
    pub first: T,
    /// Sum of their squares.
    pub second: T,
    /// Mean of ln SINR.
    pub instant_ln: T,
}

/// One source.
#[derive(Clone, Debug)]
pub struct Row<T> {
    /// The first energy seen, which the others are relative to; 0 before.
    pub reference: T,
    /// By action.
    pub moments: Vec<Moments<T>>,
}

/// All sources.
#[derive(Clone, Debug)]
pub struct ChannelMemory<T> {
    direct: Vec<Row<T>>,
    virtual_anchors: Vec<Row<T>>,
    prior_sinr: T,
}

impl<T: Real> Row<T> {
    fn empty(actions: usize) -> Self {
        let nothing = Moments { count: T::ZERO, first: T::ZERO, second: T::ZERO, instant_ln: T::ZERO };
        Self { reference: T::ZERO, moments: vec![nothing; actions] }
    }
}

impl<T: Real> ChannelMemory<T> {
    /// An empty memory.
    pub fn new(anchors: usize, slots: usize, actions: usize, prior_sinr: T) -> Self {
        Self {
            direct: vec![Row::empty(actions); anchors],
            virtual_anchors: vec![Row::empty(actions); slots],
            prior_sinr,
        }
    }

    fn row(&self, source: Source) -> &Row<T> {
        match source {
            Source::Direct { anchor } => &self.direct[anchor],
            Source::Virtual { slot, .. } => &self.virtual_anchors[slot],
        }
    }

    /// Every count loses a thousandth per cycle.
    pub fn age(&mut self) {
        for row in self.direct.iter_mut().chain(&mut self.virtual_anchors) {
            for moments in &mut row.moments {
                moments.count *= T::of(AGEING);
                moments.first *= T::of(AGEING);
                moments.second *= T::of(AGEING);
            }
        }
    }

    /// Enters a path heard with `action` that belongs to `source` with probability `weight`.
    pub fn remember(
        &mut self,
        source: Source,
        action: usize,
        library: &Library<T>,
        path: &Measurement<T>,
        weight: T,
    ) {
        let energy = path.energy * square(path.range_m);
        self.enter(source, action, library, [energy, path.sinr], weight);
    }

    /// Enters that `source` was expected in a frame received with `action` and, with probability `weight`, missed.
    pub fn remember_missed(&mut self, source: Source, action: usize, library: &Library<T>, weight: T) {
        self.enter(source, action, library, [T::ZERO, T::of(MISSED_SINR)], weight);
    }

    fn enter(
        &mut self,
        source: Source,
        action: usize,
        library: &Library<T>,
        [energy, sinr]: [T; 2],
        weight: T,
    ) {
        let num = T::of;
        let row = match source {
            Source::Direct { anchor } => &mut self.direct[anchor],
            Source::Virtual { slot, .. } => &mut self.virtual_anchors[slot],
        };
        if row.reference == T::ZERO {
            if energy == T::ZERO {
                // Never seen yet: nothing to compare a miss to.
                return;
            }
            row.reference = limited(energy, num(REFERENCE_FLOOR), T::ONE / num(REFERENCE_FLOOR));
        }
        let relative = limited(energy / row.reference, T::ZERO, num(1e6));
        let sinr_ln = ln(limited(sinr, num(1e-3), num(1e12)));
        for other in 0..library.len() {
            let moments = &mut row.moments[other];
            // Order: rho^4 as a square of squares, then the weight.
            let share = weight * square(square(library.overlap(action, other)));
            let keep = T::ONE - share * (T::ONE / num(WINDOW));
            let known = moments.count;
            moments.count = moments.count * keep + share;
            moments.first = moments.first * keep + share * relative;
            moments.second = moments.second * keep + share * square(relative);
            // A mean of one sample is that sample.
            let forgetting = larger(num(INSTANT_FORGETTING) * share, share / (known + share + num(1e-6)));
            moments.instant_ln += forgetting * (sinr_ln - moments.instant_ln);
        }
    }

    /// Forgets a virtual anchor.
    pub fn forget(&mut self, slot: usize) {
        let actions = self.virtual_anchors[slot].moments.len();
        self.virtual_anchors[slot] = Row::empty(actions);
    }

    /// Whether a source was ever seen.
    pub fn has_seen(&self, source: Source) -> bool {
        self.row(source).reference > T::ZERO
    }

    /// SINR (linear) expected of a source with an action.
    pub fn sinr(&self, source: Source, action: usize) -> T {
        let num = T::of;
        let moments = &self.row(source).moments[action];
        if moments.count < num(1e-3) {
            return self.prior_sinr;
        }
        // From the prior to the estimator's SINR within one sample, from there to the moments within eight.
        let seen = limited(moments.count, T::ZERO, T::ONE);
        let prior_ln = ln(self.prior_sinr);
        let instant_ln = prior_ln + seen * (moments.instant_ln - prior_ln);
        let trust = limited(moments.count / num(TRUSTED), T::ZERO, T::ONE);
        let by_moments = sinr_by_moments(moments);
        let blend = if trust >= T::ONE {
            by_moments
        } else {
            exp(instant_ln + trust * (ln(by_moments) - instant_ln))
        };
        smaller(blend, num(OPTIMISM) * exp(instant_ln))
    }

    /// Every number with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        for (kind, rows) in [("direct path", &self.direct), ("virtual anchor", &self.virtual_anchors)] {
            for index in 0..rows.len() {
                let row = &rows[index];
                f(format_args!("reference energy of {kind} {index}"), row.reference);
                for action in 0..row.moments.len() {
                    let moments = &row.moments[action];
                    f(format_args!("sample count of {kind} {index} at action {action}"), moments.count);
                    f(format_args!("first moment of {kind} {index} at action {action}"), moments.first);
                    f(format_args!("second moment of {kind} {index} at action {action}"), moments.second);
                    f(
                        format_args!("instant ln SINR of {kind} {index} at action {action}"),
                        moments.instant_ln,
                    );
                }
            }
        }
    }
}

fn sinr_by_moments<T: Real>(moments: &Moments<T>) -> T {
    let num = T::of;
    let mean = moments.first / moments.count;
    let spread = moments.second / moments.count - square(mean);
    let variance = spread * moments.count / larger(moments.count - T::ONE, num(0.5));
    let deterministic = square(mean) - larger(variance, T::ZERO);
    if deterministic <= T::ZERO {
        return num(0.01);
    }
    let line = sqrt(deterministic);
    limited(line / larger(mean - line, mean * num(1e-6)), num(0.01), num(1e6))
}
