//! Where the tag is in the large: lost, searched for, or off on a turn.

use super::Tracker;
use super::associate::AssociatedScan;
use super::receive::Scan;
use crate::perceptor::acquisition::{Acquisition, Landmark, Sweep};
use crate::perceptor::loss::LossMonitor;
use crate::perceptor::manoeuvre::{ACCELERATION_FACTOR, Suspicion, is_manoeuvre};
use crate::perceptor::state_filter::{Agent, Source};
use crate::real::smaller;
use heapless::Vec;
use nalgebra::{Matrix4, Vector4};

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// Gives the tag up: from now on it may be anywhere around this position, with these variances of position and
    /// velocity.
    fn lose(&mut self, position_m: [f32; 2], position_m2: [f32; 2], velocity_m2_s2: [f32; 2]) {
        let ([x, y], [xx, yy], [uu, vv]) = (position_m, position_m2, velocity_m2_s2);
        let prior = Agent {
            mean: Vector4::new(x, y, 0.0, 0.0),
            covariance: Matrix4::from_diagonal(&Vector4::new(xx, yy, uu, vv)),
        };
        let speed = self.config.start.velocity_std_m_s;
        self.loss = LossMonitor::default();
        self.acquisition = Some(Acquisition::new(prior, speed * speed));
    }

    /// After a gap: the tag is somewhere between where it was and where its velocity would have brought it, and what its
    /// velocity was then says little of now.
    pub(super) fn lose_sight(&mut self, last: &Agent, predicted: &Agent) {
        let Agent { mean: from, .. } = last;
        let Agent { mean: to, covariance: c } = predicted;
        let reach = self.config.motion.position_std_limit_m;
        let speed = self.config.start.velocity_std_m_s;
        let (dx, dy) = (to.x - from.x, to.y - from.y);
        let within = |variance_m2: f32| smaller(variance_m2, reach * reach);
        let speed_m2_s2 = speed * speed;
        self.lose(
            [from.x, from.y],
            [within(c.m11 + dx * dx), within(c.m22 + dy * dy)],
            [speed_m2_s2 + from.z * from.z, speed_m2_s2 + from.w * from.w],
        );
    }

    /// Notices when the tag is not where it is believed to be.
    pub(super) fn watch(&mut self, heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>) -> bool {
        self.loss.observe(heard.iter().fold(0.0, |sum, associated| sum + associated.evidence_nat));
        if !self.loss.is_lost() {
            return false;
        }
        let agent = self.filter.agent();
        let reach = self.config.motion.position_std_limit_m;
        let speed = self.config.start.velocity_std_m_s;
        self.lose([agent.mean.x, agent.mean.y], [reach * reach; 2], [speed * speed; 2]);
        if let Some(acquisition) = &mut self.acquisition {
            acquisition.suggest(agent);
        }
        true
    }

    /// While it is not known where the tag is: weighs the places it may be at, and puts it where it must be.
    #[inline(never)]
    pub(super) fn acquire(
        &mut self,
        scans: &Vec<Scan<PATHS>, ANCHORS>,
        elapsed_s: f32,
        tag_height_m: Option<f32>,
    ) {
        if self.acquisition.is_none() {
            return;
        }
        let mut detections: Vec<(f32, [f32; VAS]), ANCHORS> = Vec::new();
        for scan in scans {
            let direct = self.detection(Source::Direct { anchor: scan.anchor }, scan, None);
            // As many as scans: the push succeeds.
            let _ = detections.push((direct, self.detections(scan)));
        }
        let Self { acquisition, discovery, filter, environment, anchors, unexplained, config, .. } = self;
        let Some(acquiring) = acquisition else { return };
        // Candidates are located relative to a tag that is about to jump.
        discovery.clear();
        acquiring.predict(&config.motion, elapsed_s);
        let per_m = 1.0 / config.ranging.max_range_m;
        let settings = &config.association;
        let known = &*filter;
        let mut backgrounds: Vec<[f32; PATHS], ANCHORS> = Vec::new();
        for scan in scans {
            let all_per_m = unexplained.get(scan.anchor).copied().unwrap_or(1.0) * per_m;
            let false_share = settings.clutter_per_anchor * per_m / all_per_m;
            let unmapped = (1.0 - false_share) * settings.detection_probability;
            // As many as scans: the push succeeds.
            let _ = backgrounds.push(acquiring.backgrounds(
                scan.anchor,
                &scan.measurements,
                all_per_m,
                unmapped,
                elapsed_s,
            ));
        }
        let sweeps = scans.iter().zip(&backgrounds).map(|(scan, all_per_m)| {
            let (bias_m, bias_variance_m2) = known.bias_m(scan.anchor).unwrap_or((0.0, 0.0));
            let sweep = Sweep {
                measurements: &scan.measurements,
                bias_m,
                bias_variance_m2,
                all_per_m,
                false_alarms_per_m: settings.clutter_per_anchor * per_m,
                anywhere_per_m: per_m,
            };
            (scan.anchor, sweep)
        });
        let landmarks = |anchor: usize| {
            let own = anchors.get(anchor);
            let scan = scans.iter().position(|scan| scan.anchor == anchor).unwrap_or(0);
            let detection = detections.get(scan);
            let height_m = tag_height_m.zip(own).map_or(0.0, |(height, own)| own.height_m - height);
            let direct = own.map(|own| Landmark {
                position_m: own.position_m,
                covariance_m2: [0.0; 3],
                height_m,
                detection: detection.map_or(0.0, |(direct, _)| *direct),
            });
            let reflected = environment.iter().filter(move |(_, record)| record.anchor == anchor);
            direct.into_iter().chain(reflected.filter_map(move |(slot, record)| {
                let (a, c) = known.virtual_anchor(slot)?;
                Some(Landmark {
                    position_m: [a.x, a.y],
                    covariance_m2: [c.m11, c.m21, c.m22],
                    height_m,
                    detection: record.existence * detection?.1.get(slot)?,
                })
            }))
        };
        if !acquiring.observe(sweeps, landmarks) {
            return;
        }
        match acquiring.settled() {
            Some(agent) => {
                filter.place(&agent);
                *acquisition = None;
            }
            None => filter.place(&acquiring.summary()),
        }
    }

    /// Widens the prediction where a manoeuvre explains the scans far better than the motion as configured does.
    #[inline(never)]
    pub(super) fn follow_manoeuvre(
        &mut self,
        scans: &Vec<Scan<PATHS>, ANCHORS>,
        elapsed_s: f32,
        tag_height_m: Option<f32>,
    ) {
        let mut suspicion = Suspicion::default();
        for scan in scans {
            let source = Source::Direct { anchor: scan.anchor };
            let Some(sight) = self.sight(scan.anchor, tag_height_m) else { continue };
            let Some(regression) = self.filter.regress(source, &sight) else { continue };
            let mut nearest = f32::INFINITY;
            for measurement in &scan.measurements {
                let innovation = measurement.range_m - regression.range_m;
                let variance = regression.variance_m2() + measurement.variance_m2;
                nearest = smaller(nearest, innovation * innovation / variance);
            }
            suspicion.enter(self.detection(source, scan, Some(regression.range_m)), nearest);
        }
        if !suspicion.is_raised() {
            return;
        }
        let motion = self.evidence_nat(scans, tag_height_m);
        let predicted = self.filter.agent_covariance();
        let acceleration_std_m_s2 = ACCELERATION_FACTOR * self.config.motion.acceleration_std_m_s2;
        self.filter.disturb(acceleration_std_m_s2, elapsed_s);
        let manoeuvre = self.evidence_nat(scans, tag_height_m);
        if !is_manoeuvre(motion, manoeuvre) {
            self.filter.undisturb(&predicted);
        }
    }

    /// Evidence of all scans that the tag is where it is predicted to be, nats.
    fn evidence_nat(&self, scans: &Vec<Scan<PATHS>, ANCHORS>, tag_height_m: Option<f32>) -> f32 {
        let mut evidence = 0.0;
        for scan in scans {
            if let Some(expected) = self.expect(scan, tag_height_m) {
                evidence += expected.evidence_nat(scan, &self.clutter(scan.anchor));
            }
        }
        evidence
    }
}
