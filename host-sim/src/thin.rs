//! Thinning: a recording as a radio would have made it that measures less often, or from fewer anchors at a time.

use crate::recording::{Cycle, Motion, Recording};

/// What is kept of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Thinning {
    /// Least time between two cycles kept, seconds; all are kept without.
    pub every_s: Option<f64>,
    /// Most ranges of a cycle, one anchor after the other: those of the anchor that has waited longest first. Frames are
    /// kept of the anchors of these ranges; where a cycle has frames alone, of as many anchors.
    pub ranges_per_cycle: Option<usize>,
}

impl Thinning {
    /// What it leaves of a recording: the same tag, of which less is measured. The motion stays as it is told, by its
    /// density. Cycles without a measurement are kept like the others: time went on.
    pub fn of(&self, recording: &Recording) -> Recording {
        let mut last_kept_s: Option<f64> = None;
        // When each anchor was last kept, by the number of the cycle.
        let mut served = vec![0_usize; recording.anchors.len()];
        let mut cycles: Vec<Cycle> = Vec::new();
        for cycle in &recording.cycles {
            let is_due = match (last_kept_s, self.every_s) {
                // A rounding of the times is no reason to wait for another cycle.
                (Some(last_s), Some(every_s)) => cycle.time_s - last_s >= every_s - 1e-6,
                _ => true,
            };
            if is_due {
                last_kept_s = Some(cycle.time_s);
                cycles.push(self.of_cycle(cycle, cycles.len() + 1, &mut served));
            }
        }
        let motion = Motion {
            acceleration_std_m_s2: None,
            acceleration_density_m2_s3: Some(recording.acceleration_density_m2_s3()),
            ..recording.motion
        };
        let source = format!("{}; thinned: {self}", recording.source);
        Recording { motion, source, cycles, ..recording.clone() }
    }

    fn of_cycle(&self, cycle: &Cycle, number: usize, served: &mut [usize]) -> Cycle {
        let Some(most) = self.ranges_per_cycle else { return cycle.clone() };
        let mut anchors: Vec<usize> = (0..served.len())
            .filter(|anchor| match cycle.ranges.is_empty() {
                true => cycle.frames.iter().any(|frame| frame.anchor == *anchor),
                false => cycle.ranges.iter().any(|range| range.anchor == *anchor),
            })
            .collect();
        // Stable: of those that waited equally long, the first.
        anchors.sort_by_key(|anchor| served[*anchor]);
        let mut kept = Cycle { ranges: Vec::new(), frames: Vec::new(), truth_paths: Vec::new(), ..*cycle };
        let mut taken = 0;
        for anchor in anchors {
            if taken >= most {
                break;
            }
            let ranges = cycle.ranges.iter().filter(|range| range.anchor == anchor).take(most - taken);
            kept.ranges.extend(ranges.cloned());
            kept.frames.extend(cycle.frames.iter().filter(|frame| frame.anchor == anchor).cloned());
            kept.truth_paths.extend(cycle.truth_paths.iter().filter(|path| path.anchor == anchor).cloned());
            taken = if cycle.ranges.is_empty() { taken + 1 } else { kept.ranges.len() };
            served[anchor] = number;
        }
        kept
    }
}

impl std::fmt::Display for Thinning {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let every = self.every_s.map(|every_s| format!("a cycle every {every_s} s at most"));
        let ranges = self.ranges_per_cycle.map(|most| format!("ranges per cycle: {most} at most"));
        let both: Vec<String> = every.into_iter().chain(ranges).collect();
        formatter.write_str(&both.join(", "))
    }
}
