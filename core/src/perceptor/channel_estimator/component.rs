//! Paths while they are being estimated, in order of delay.
//!
//! A pulse reaches a few samples only, and components that do not reach each other do not know of each other: what
//! a component costs depends on its neighbours, not on how many there are in the frame.

use crate::model::observation::Complex;
use crate::radio::pulse::PulseTable;
use crate::real::{floor, larger, sqrt};

/// One path while it is being estimated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Component {
    /// Delay, samples into the frame.
    pub position: f32,
    /// The samples that its pulse reaches: the first, and the one after the last.
    first: u16,
    end: u16,
    /// Whether its delay may still move: it or a neighbour of it has.
    pub moving: bool,
    /// Prior variance over noise level.
    pub prior: f32,
    /// Noise level at the delay.
    pub level: f32,
    /// Its square root.
    pub unit: f32,
    /// y(tau) at the delay, in units of the samples.
    pub matched: Complex,
    /// Posterior mean amplitude, in units of the samples.
    pub amplitude: Complex,
    /// Marginal-likelihood gain |q|^2 / s without this component's own share.
    pub gain: f32,
    /// kappa: with less gain it is none.
    pub threshold: f32,
}

impl Component {
    /// A component that has yet to settle.
    pub fn new(position: f32, matched: Complex, table: &PulseTable) -> Self {
        let mut component = Self {
            position,
            first: 0,
            end: 0,
            moving: true,
            prior: 1.0,
            level: 1.0,
            unit: 1.0,
            matched,
            amplitude: matched,
            gain: 0.0,
            threshold: 0.0,
        };
        component.move_to(position, matched, table);
        component
    }

    /// Puts it where the matched filter's output is `matched`.
    pub fn move_to(&mut self, position: f32, matched: Complex, table: &PulseTable) {
        let support = table.support_samples();
        self.position = position;
        self.matched = matched;
        // Not negative, so truncation is the floor; frames are shorter than 65536 samples.
        self.first = larger(floor(position - support), 0.0) as u16;
        self.end = larger(position + support + 1.0, 0.0) as u16;
    }

    /// Sets the noise level at its delay.
    pub fn set_level(&mut self, level: f32) {
        self.level = level;
        self.unit = sqrt(level);
    }
}

/// Brings components into the order of their delays.
pub(super) fn sort(components: &mut [Component]) {
    // They hardly ever leave it: insertion.
    for end in 1..components.len() {
        for k in (1..=end).rev() {
            match components.get_mut(k - 1..=k) {
                Some([before, after]) if after.position < before.position => core::mem::swap(before, after),
                _ => break,
            }
        }
    }
}

/// The first of the components from `from` on that does not reach the one after it, and one more: the end of those
/// that know of each other.
pub(super) fn cluster_end(components: &[Component], from: usize, table: &PulseTable) -> usize {
    let tail = components.get(from..).unwrap_or(&[]);
    let reaches = |pair: &[Component]| match pair {
        [a, b] => b.position - a.position < table.support_samples(),
        _ => false,
    };
    from + 1 + tail.windows(2).take_while(|pair| reaches(pair)).count()
}

/// Walks the samples of a frame with the components that reach each.
pub(super) struct Reach<'a> {
    components: &'a [Component],
    /// Index of the first of those that reach the present sample.
    from: usize,
    active: &'a [Component],
    /// The samples that they all reach, and no other: the first, and the one after the last.
    since: usize,
    until: usize,
}

impl<'a> Reach<'a> {
    pub fn new(components: &'a [Component]) -> Self {
        Self { components, from: 0, active: &[], since: 0, until: 0 }
    }

    /// The components that reach sample `n`: the index of the first, all of them, and the sample at which they change.
    #[inline]
    pub fn at(&mut self, n: usize) -> (usize, &'a [Component], usize) {
        if n >= self.until || n < self.since {
            self.change(n);
        }
        (self.from, self.active, self.until)
    }

    // Rare beside the samples: kept out of their loops.
    #[inline(never)]
    fn change(&mut self, n: usize) {
        let first = |component: &Component| usize::from(component.first);
        let end = |component: &Component| usize::from(component.end);
        // In order of delay, first and last samples are so too.
        self.from = self.components.iter().take_while(|component| end(component) <= n).count();
        let to = self.components.iter().take_while(|component| first(component) <= n).count();
        self.active = self.components.get(self.from..to).unwrap_or(&[]);
        let at = |index: Option<usize>| index.and_then(|index| self.components.get(index));
        let left = at(self.from.checked_sub(1)).map_or(0, end);
        let entered = at(to.checked_sub(1)).map_or(0, first);
        self.since = left.max(entered);
        let leaves = at(Some(self.from)).map_or(usize::MAX, end);
        self.until = leaves.min(at(Some(to)).map_or(usize::MAX, first));
    }
}
