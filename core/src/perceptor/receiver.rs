//! Receiver: bad input is refused, frames become paths, and paths and ranges become one scan per anchor.

use super::channel_estimator::residual::Residual;
use super::channel_estimator::{ChannelEstimate, ChannelEstimator, EstimatorSettings};
use super::gain_control::GainControl;
use super::scan::{FrameLevel, Scan};
use crate::error::Error;
use crate::model::measurement::{Measurement, Ranging};
use crate::model::observation::{
    Frame, FrameRules, Observation, RangeScan, Samples, check_frame, check_scan,
};
use crate::model::work::Work;
use crate::radio::Radio;
use crate::radio::library::Library;
use crate::radio::pulse::Pulse;
use crate::real::{SPEED_OF_LIGHT_M_S, smaller};
use crate::snapshot::{Sealed, Written, seal, seal_with, stored};
use heapless::Vec;

/// What the receiver is told of an anchor's link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkView {
    /// The action that the next frame is expected with.
    pub expected: usize,
    /// The action held.
    pub held: usize,
    /// The action that a lost tag is sought with in place of the one held.
    pub sought_with: Option<usize>,
    /// Whether it is not known where the tag is.
    pub is_lost: bool,
    /// ln of the power lost to the reference carrier, at the action of the frame.
    pub loss_ln: f32,
    /// What a frame may cost.
    pub most_work: u32,
}

/// The scans of a cycle, in the order of the anchors.
pub type Scans<const ANCHORS: usize, const PATHS: usize> = Vec<Scan<PATHS>, ANCHORS>;

/// The receiver of all anchors: what it keeps from cycle to cycle, and what is left of the last frames, by so many points. With `FRAMES`
/// 0 it takes ranges alone, and has no channel estimator.
#[derive(Clone, Debug)]
pub struct Receiver<const ANCHORS: usize, const PATHS: usize, const POINTS: usize, const FRAMES: usize> {
    radio: Radio,
    estimator_settings: EstimatorSettings,
    ranging: Ranging,
    /// Estimator for the pulse it was last used with; rebuilt when the pulse changes, so no state. One serves all anchors.
    estimator: [ChannelEstimator<PATHS>; FRAMES],
    estimator_pulse: Pulse,
    gain_control: [GainControl; ANCHORS],
    last_sequence: [Option<u32>; ANCHORS],
    /// Time since the last scan and the last frame of every anchor, seconds.
    silent_s: [[f32; 2]; ANCHORS],
    /// Threshold on the normalised energy of a path, of the last anchor's last frame; 0 without frames.
    threshold: f32,
    /// What the paths of every anchor's last frame left of it.
    residuals: [Residual<POINTS>; ANCHORS],
    /// Whether that is kept.
    leaves: bool,
}

/// Which anchors have delivered a frame and ranges in a cycle.
#[derive(Clone, Copy, Debug)]
pub struct Delivered<const ANCHORS: usize> {
    framed: [bool; ANCHORS],
    ranged: [bool; ANCHORS],
}

impl<const ANCHORS: usize> Delivered<ANCHORS> {
    /// None.
    pub const NONE: Self = Self { framed: [false; ANCHORS], ranged: [false; ANCHORS] };
}

impl<const ANCHORS: usize, const PATHS: usize, const POINTS: usize, const FRAMES: usize>
    Receiver<ANCHORS, PATHS, POINTS, FRAMES>
{
    /// Without a radio: to be started.
    pub const fn empty() -> Self {
        Self {
            radio: Radio::NONE,
            estimator_settings: EstimatorSettings::NONE,
            ranging: Ranging::NONE,
            estimator: [const { ChannelEstimator::empty() }; FRAMES],
            estimator_pulse: Pulse::NONE,
            gain_control: [GainControl::NONE; ANCHORS],
            last_sequence: [None; ANCHORS],
            silent_s: [[0.0; 2]; ANCHORS],
            threshold: 0.0,
            residuals: [const { Residual::empty() }; ANCHORS],
            leaves: false,
        }
    }

    /// Nothing received yet; `pulse` is that of the first action. What paths leave of frames is kept where it `leaves` anything.
    #[inline(never)]
    pub fn start(
        &mut self,
        radio: Radio,
        estimator_settings: EstimatorSettings,
        ranging: Ranging,
        pulse: Pulse,
        leaves: bool,
    ) {
        self.radio = radio;
        self.estimator_settings = estimator_settings;
        self.ranging = ranging;
        self.rebuild(pulse);
        self.threshold =
            self.estimator.first().map_or(0.0, |estimator| estimator.threshold(&Samples::Complex(&[])));
        self.leaves = leaves && POINTS > 0;
        self.forget();
    }

    /// Without a radio again.
    #[inline(never)]
    pub fn clear(&mut self) {
        self.estimator.iter_mut().for_each(|estimator| *estimator = ChannelEstimator::empty());
        self.threshold = 0.0;
        self.radio = Radio::NONE;
        self.estimator_settings = EstimatorSettings::NONE;
        self.ranging = Ranging::NONE;
        self.estimator_pulse = Pulse::NONE;
        self.leaves = false;
        self.forget();
    }

    /// As if nothing had been received.
    fn forget(&mut self) {
        self.gain_control = [GainControl::NONE; ANCHORS];
        self.last_sequence = [None; ANCHORS];
        self.silent_s = [[0.0; 2]; ANCHORS];
        self.residuals.iter_mut().for_each(Residual::clear);
    }

    /// Time passes.
    pub fn advance(&mut self, elapsed_s: f32) {
        // A day is as good as for ever.
        let later = |silent_s: &mut f32| *silent_s = smaller(*silent_s + elapsed_s, 86_400.0);
        self.silent_s.iter_mut().flatten().for_each(later);
    }

    /// Refuses a bad observation of one of the first `anchors`; `delivered` says what came before in the same cycle.
    ///
    /// # Errors
    /// What is wrong with it; nothing has changed then.
    pub fn check<const ACTIONS: usize>(
        &self,
        observation: &Observation<'_>,
        anchors: usize,
        library: &Library<ACTIONS>,
        delivered: &mut Delivered<ANCHORS>,
    ) -> Result<(), Error> {
        let anchor = observation.anchor();
        let unknown = Error::UnknownAnchor { anchor };
        if anchor >= anchors {
            return Err(unknown);
        }
        let seen = match observation {
            Observation::Frame(_) => delivered.framed.get_mut(anchor),
            Observation::Ranges(_) => delivered.ranged.get_mut(anchor),
        };
        let seen = seen.ok_or(unknown)?;
        if *seen {
            return Err(Error::DuplicateFrame { anchor });
        }
        match observation {
            Observation::Frame(frame) if FRAMES == 0 => {
                return Err(Error::FrameLength { anchor, given: frame.samples.len(), expected: 0 });
            }
            Observation::Frame(frame) => {
                if library.get(frame.action).is_none() {
                    return Err(Error::UnknownAction { action: frame.action });
                }
                if frame.sequence.is_some() && self.last_sequence.get(anchor) == Some(&frame.sequence) {
                    return Err(Error::DuplicateFrame { anchor });
                }
                let rules = FrameRules {
                    samples: self.radio.samples_per_frame,
                    full_scale: self.radio.full_scale,
                    max_range_m: self.ranging.max_range_m,
                };
                check_frame(frame, &rules)?;
            }
            Observation::Ranges(scan) => check_scan(scan, self.ranging.max_range_m)?,
        }
        *seen = true;
        Ok(())
    }

    /// Takes an observation in that [`Self::check`] has passed; `seen` is shown what was estimated of a frame.
    #[inline(never)]
    pub fn receive<const ACTIONS: usize>(
        &mut self,
        scans: &mut Scans<ANCHORS, PATHS>,
        observation: &Observation<'_>,
        link: &LinkView,
        library: &Library<ACTIONS>,
        seen: impl FnOnce(&ChannelEstimate<PATHS>),
    ) {
        let anchor = observation.anchor();
        let place = scans.iter().position(|scan| scan.anchor >= anchor).unwrap_or(scans.len());
        if scans.get(place).is_none_or(|scan| scan.anchor != anchor) {
            let elapsed_s = self.silent_s.get_mut(anchor).map_or(0.0, |[scan_s, _]| core::mem::take(scan_s));
            // Later anchors' scans move up by one. One per anchor: there is room.
            let mut last = Scan::new(anchor, link.expected, elapsed_s);
            for scan in scans.iter_mut().skip(place) {
                core::mem::swap(scan, &mut last);
            }
            let _ = scans.push(last);
        }
        let Some(scan) = scans.get_mut(place) else { return };
        match observation {
            Observation::Ranges(ranges) => self.take_ranges(ranges, scan),
            Observation::Frame(frame) => self.take_frame(frame, scan, link, library, seen),
        }
    }

    fn take_ranges(&self, ranges: &RangeScan<'_>, scan: &mut Scan<PATHS>) {
        let ranging = &self.ranging;
        scan.take_ranges(ranges.ranges.iter().map(|range| Measurement {
            range_m: range.range_m,
            variance_m2: ranging.measurement_variance_m2(range.variance_m2),

            sinr: 0.0,
            energy: 0.0,
            false_alarm: 1.0,
        }));
    }

    // Stages are kept apart so that each reuses the stack of the one before.
    #[inline(never)]
    fn take_frame<const ACTIONS: usize>(
        &mut self,
        frame: &Frame<'_>,
        scan: &mut Scan<PATHS>,
        link: &LinkView,
        library: &Library<ACTIONS>,
        seen: impl FnOnce(&ChannelEstimate<PATHS>),
    ) {
        let Self { radio, estimator, estimator_pulse, .. } = self;
        let (Some(action), Some(estimator)) = (library.get(frame.action), estimator.first_mut()) else {
            return;
        };
        let pulse = radio.pulse(action);
        if pulse != *estimator_pulse {
            let (spacing_s, samples) = (radio.sample_spacing_s, radio.samples_per_frame);
            let false_paths = radio.false_paths_per_frame;
            estimator.change(pulse, spacing_s, samples, false_paths, self.estimator_settings);
            *estimator_pulse = pulse;
        }
        let (samples, first_sample_delay_s) = (frame.samples, frame.first_sample_delay_s);
        let estimate = estimator.estimate_checked(samples, first_sample_delay_s, link.most_work);
        (scan.work, scan.cut_short) = (Work::of(estimate.work), estimate.cut_short);
        seen(&estimate);
        let elapsed_s =
            self.silent_s.get_mut(frame.anchor).map_or(0.0, |[_, frame_s]| core::mem::take(frame_s));
        let unit = self.unit(frame, estimate.noise.white, link, elapsed_s);
        if let (Some(sequence), Some(last)) = (frame.sequence, self.last_sequence.get_mut(frame.anchor)) {
            *last = Some(sequence);
        }
        let Self { ranging, estimator, radio, residuals, .. } = self;
        if self.leaves
            && let (Some(estimator), Some(residual)) = (estimator.first(), residuals.get_mut(frame.anchor))
        {
            let longest_m = ranging.max_range_m;
            estimator.leave(frame.samples, frame.first_sample_delay_s, &estimate, longest_m, residual);
        }
        scan.action = frame.action;
        let pulse_m = pulse.duration_s * SPEED_OF_LIGHT_M_S;
        scan.frame = Some(FrameLevel {
            level: estimate.noise,
            unit,
            first_sample_delay_s: frame.first_sample_delay_s,
            sample_spacing_s: radio.sample_spacing_s,
            elapsed_s,
            threshold: estimate.threshold,
            resolution_m: pulse_m,
            alike_m2: ranging.alike_m2(pulse_m, elapsed_s),
        });
        for path in &estimate.paths {
            let range_m = path.range_m();
            if range_m <= 0.0 || range_m > ranging.max_range_m {
                continue;
            }
            let [re, im] = path.amplitude;
            scan.take_path(Measurement {
                range_m,
                variance_m2: ranging.path_variance_m2(pulse.range_variance_m2(path.sinr), pulse_m),
                sinr: path.sinr,
                energy: (re * re + im * im) / unit,
                false_alarm: 1.0,
            });
        }
    }

    /// What the powers of a frame with this level of white noise are measured in.
    fn unit(&mut self, frame: &Frame<'_>, white: f32, link: &LinkView, elapsed_s: f32) -> f32 {
        let Some(gain_control) = self.gain_control.get_mut(frame.anchor) else { return 1.0 };
        if !self.radio.gain_control {
            return 1.0;
        }
        // Where choices are announced, the last frame of a turn comes after it.
        let own = Some(frame.action);
        let is_sought = link.is_lost
            && frame.action != link.held
            && (link.sought_with == own || gain_control.sought_with() == own);
        gain_control.unit(frame.samples, white, elapsed_s, frame.action, link.loss_ln, is_sought)
    }

    /// What is left of the frame in a scan; `None` where that is not kept, or there is none.
    pub fn residual(&self, scan: &Scan<PATHS>) -> Option<&Residual<POINTS>> {
        let residual = self.residuals.get(scan.anchor)?;
        (POINTS > 0 && self.leaves && Self::has_frame(scan)).then_some(residual)
    }

    /// Whether a frame was received with a scan.
    pub fn has_frame(scan: &Scan<PATHS>) -> bool {
        FRAMES > 0 && scan.is_framed()
    }

    /// All of a cycle is received.
    pub fn complete(&mut self, scans: &mut Scans<ANCHORS, PATHS>) {
        for scan in scans {
            // In the order of the anchors, whichever came last.
            if Self::has_frame(scan) {
                scan.grade_paths();
                self.threshold = scan.threshold();
            }
        }
    }

    /// Whether the last frame of an anchor was one in which a lost tag was sought with another action than the one held.
    pub fn is_sought(&self, anchor: usize) -> bool {
        self.gain_control.get(anchor).and_then(GainControl::sought_with).is_some()
    }

    /// The tag was found with an anchor's last frame: see [`GainControl::found`].
    pub fn found(&mut self, anchor: usize) -> Option<f32> {
        self.gain_control.get_mut(anchor).and_then(GainControl::found)
    }

    /// What is known of every anchor's frames where the receiver controls its gain.
    pub fn gain_control(&self) -> &[GainControl; ANCHORS] {
        &self.gain_control
    }

    /// The counter of every anchor's last frame.
    pub fn last_sequence(&self) -> &[Option<u32>; ANCHORS] {
        &self.last_sequence
    }

    /// Time since the last scan and the last frame of every anchor, seconds.
    pub fn silent_s(&self) -> &[[f32; 2]; ANCHORS] {
        &self.silent_s
    }

    /// Time since anything was heard before these scans, seconds.
    pub fn unheard_s(&self, scans: &Scans<ANCHORS, PATHS>) -> f32 {
        let mut unheard_s = f32::INFINITY;
        for (anchor, [silent_s, _]) in self.silent_s.iter().enumerate() {
            let scan = scans.iter().find(|scan| scan.anchor == anchor);
            unheard_s = smaller(unheard_s, scan.map_or(*silent_s, |scan| scan.elapsed_s));
        }
        unheard_s
    }

    /// Seals what the estimator was made of: it is the same until the pulse changes.
    pub(crate) fn seal_estimator(&self) -> Sealed {
        seal(&self.estimator)
    }

    /// Seals what is kept from cycle to cycle: what is left of the last frames is not read again.
    pub(crate) fn seal(&self) -> Sealed {
        let Self { gain_control, last_sequence, silent_s, threshold, .. } = self;
        seal_with(|to| {
            gain_control.write(to);
            last_sequence.write(to);
            silent_s.write(to);
            threshold.write(to);
        })
    }

    /// Makes the estimator anew, for this pulse.
    #[inline(never)]
    pub(crate) fn rebuild(&mut self, pulse: Pulse) {
        let (spacing_s, samples) = (self.radio.sample_spacing_s, self.radio.samples_per_frame);
        let false_paths = self.radio.false_paths_per_frame;
        for estimator in &mut self.estimator {
            estimator.start(pulse, spacing_s, samples, false_paths, self.estimator_settings);
        }
        self.estimator_pulse = pulse;
    }

    /// Whether finite numbers are what they may be.
    pub(crate) fn is_sound(&self) -> bool {
        let is_time = |silent_s: &f32| *silent_s >= 0.0;
        (FRAMES == 0 || self.threshold > 0.0) && self.silent_s.iter().flatten().all(is_time)
    }

    /// Threshold on the normalised energy of a path: that of the last anchor's last frame.
    pub fn threshold(&self) -> f32 {
        self.threshold
    }
}

stored!(
    Receiver<const ANCHORS, const PATHS, const POINTS, const FRAMES> { gain_control, last_sequence, silent_s, threshold, residuals }
    told { radio, estimator_settings, ranging, leaves }
    made { estimator, estimator_pulse }
);
