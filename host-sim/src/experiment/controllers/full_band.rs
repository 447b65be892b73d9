//! The full band: the tracker is told the true SINR of what it knows of, at every carrier. The published experiments had
//! such records of every place; a radio has not.

use crate::channel::Channel;
use crate::replay::SizedTracker;
use cogmint_core::Error;
use cogmint_core::model::source::Source;

/// A source of the tracker is the image this near to it, metres.
const SAME_M: f64 = 0.5;
/// SINR of what does not arrive.
const NOTHING: f32 = 1e-3;

/// Tells a tracker the SINR that its direct paths and virtual anchors have in a cycle.
///
/// # Errors
/// The core refuses it, which would be a defect.
pub fn tell<const A: usize>(
    tracker: &mut SizedTracker<A>,
    channel: &Channel,
    cycle: usize,
) -> Result<(), Error> {
    let direct = tracker.anchors().iter().enumerate();
    let mut sources: Vec<(Source, usize, [f32; 2])> =
        direct.map(|(anchor, at)| (Source::Direct { anchor }, anchor, at.position_m)).collect();
    for (slot, record) in tracker.environment().iter() {
        if let Some((at, _)) = tracker.image(slot) {
            sources.push((Source::Virtual { anchor: record.anchor, slot }, record.anchor, [at.x, at.y]));
        }
    }
    let actions = tracker.library().len();
    for anchor in 0..tracker.anchors().len() {
        let paths = channel.paths(cycle, anchor);
        let components: Vec<_> =
            (0..actions).map(|action| channel.components_of(&paths, cycle, anchor, action)).collect();
        for (source, _, [x, y]) in sources.iter().filter(|(_, of, _)| *of == anchor) {
            let is_near = |image: usize| {
                let [u, v] = channel.images(anchor)[image].position_m;
                (u - f64::from(*x)).hypot(v - f64::from(*y)) < SAME_M
            };
            let sinr: Vec<f32> = components
                .iter()
                .map(|components| {
                    let own = components.iter().filter(|component| is_near(component.source));
                    own.fold(NOTHING, |most, component| most.max(component.sinr as f32))
                })
                .collect();
            tracker.tell_channel(*source, &sinr)?;
        }
    }
    Ok(())
}
