//! The map alone as bytes: what a tracker has learnt of its surroundings, for a tracker with other settings or sizes.
//!
//! It has surfaces with their numbers, their joint covariance and their existence, the sources seen in them, and what the walls of the
//! plan let through. It is of the same anchors and of the same map told, virtual anchors and plan (a digest of both is in it, and of
//! nothing else); settings, actions and sizes may be others. What belongs to a place of the tag, to a carrier or to a run is not in it:
//! visibility, SINR, biases, candidates. What there is no room for is left out.
//!
//! The layout is that of [`crate::snapshot`], with `COGM` in front, a version of its own, and that digest.

use super::Tracker;
use crate::memory::environment::{Origin, Record, SurfaceRecord};
use crate::model::image::Sequence;
use crate::model::surface::{Line, Surface};
use crate::snapshot::{self, Blank, Digest, Form, Reader, Sink, SnapshotError, Written};
use heapless::Vec;
use nalgebra::{Matrix2, Vector2};

/// Guard: against maps of another layout, which are refused: counts the versions of the format.
const MAP: Form = Form { magic: *b"COGM", version: 1 };

/// Capacity: surfaces of a stored map, whatever the sizes of the tracker: as many as a slot can name.
const MOST: usize = 256;

/// What of a stored map there was room for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct MapRestored {
    /// Surfaces taken over.
    pub surfaces: u32,
    /// Surfaces left out: there is no slot left for them, or no source for which there is one is seen in them.
    pub surfaces_left_out: u32,
    /// Sources taken over.
    pub sources: u32,
    /// Sources left out: there is no slot left for them, or for a surface that they are seen in.
    pub sources_left_out: u32,
}

/// Where a stored surface is known from.
#[derive(Clone, Copy, Debug, PartialEq)]
enum From {
    /// It is a wall of the plan, of this index.
    Plan(u16),
    /// A virtual anchor that was told by its position had this slot.
    Position(u16),
    /// It was found, as a wall on a line or as one image alone.
    Found(Option<Line>),
}

impl Written for From {
    fn write(&self, to: &mut impl Sink) {
        let (kind, index, line): (u8, u16, Option<Line>) = match self {
            Self::Plan(wall) => (0, *wall, None),
            Self::Position(slot) => (1, *slot, None),
            Self::Found(line) => (2, 0, *line),
        };
        kind.write(to);
        index.write(to);
        line.is_some().write(to);
        if let Some(line) = line {
            line.write(to);
        }
    }
}

impl From {
    fn read(from: &mut Reader<'_>) -> Result<Self, SnapshotError> {
        let kind: u8 = value(from)?;
        let index: u16 = value(from)?;
        let line = if value(from)? {
            let (centre_m, normal) = value(from)?;
            Some(Line { centre_m, normal })
        } else {
            None
        };
        match kind {
            0 => Ok(Self::Plan(index)),
            1 => Ok(Self::Position(index)),
            2 => Ok(Self::Found(line)),
            _ => Err(SnapshotError::Damaged),
        }
    }
}

/// A surface of a stored map.
#[derive(Clone, Copy, Debug, PartialEq)]
struct StoredSurface {
    from: From,
    state: [f32; 2],
    /// Variances and covariance of the two numbers: (1, 1), (2, 1), (2, 2).
    own: [f32; 3],
    existence: f32,
}

impl StoredSurface {
    fn read(from: &mut Reader<'_>) -> Result<Self, SnapshotError> {
        Ok(Self { from: From::read(from)?, state: value(from)?, own: value(from)?, existence: value(from)? })
    }

    fn covariance(&self) -> Matrix2<f32> {
        let [m11, m21, m22] = self.own;
        Matrix2::new(m11, m21, m21, m22)
    }
}

/// A value where there was none.
fn value<T: Blank>(from: &mut Reader<'_>) -> Result<T, SnapshotError> {
    let mut value = T::blank();
    value.read(from)?;
    Ok(value)
}

/// The block between two surfaces as it is stored.
fn block_of(block: Matrix2<f32>) -> [f32; 4] {
    [block.m11, block.m12, block.m21, block.m22]
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
    const FRAMES: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES, FRAMES>
{
    /// Writes the map alone between two cycles; its length, bytes. With no buffer, the error tells that length. Unlike a snapshot, it
    /// outlives other settings, actions and sizes: see [`Self::restore_map`].
    ///
    /// # Errors
    /// [`SnapshotError::Begun`], [`SnapshotError::NotStarted`]; [`SnapshotError::Room`], and nothing is written then.
    pub fn map_snapshot(&self, buffer: &mut [u8]) -> Result<usize, SnapshotError> {
        self.check_between()?;
        snapshot::write(&MAP, self.map_digest(), &MapWriter { tracker: self }, buffer)
    }

    /// Takes over a map that was learnt with the same anchors and the same map told, before the first cycle; whatever settings, actions
    /// and sizes the other tracker had. What follows the map in `bytes` is not looked at. Says what was left out.
    ///
    /// # Errors
    /// Any but [`SnapshotError::Room`], and [`SnapshotError::Begun`] after the first cycle was begun; nothing has changed then.
    pub fn restore_map(&mut self, bytes: &[u8]) -> Result<MapRestored, SnapshotError> {
        self.check_between()?;
        if self.cycle > 0 {
            return Err(SnapshotError::Begun);
        }
        let body = snapshot::open(&MAP, self.map_digest(), bytes)?;
        let stored = StoredMap::check(body, self.anchors.len())?;
        let Self { plan, belief, environment, transmission, .. } = self;
        let mut restored = MapRestored::default();
        let mut slots: Vec<Option<u8>, MOST> = Vec::new();
        let mut from = stored.body();
        let count: u16 = value(&mut from)?;
        let begin_of_surfaces = from.clone();
        // Which slots there are for them, in the filter as it was told.
        for _ in 0..count {
            let surface = StoredSurface::read(&mut from)?;
            let free = || (0..SURFACES).find(|slot| environment.surface(*slot).is_none());
            let is_there = |slot: &usize| environment.surface(*slot).is_some();
            let (slot, origin) = match surface.from {
                From::Plan(wall) => (
                    plan.walls().get(usize::from(wall)).and_then(|wall| wall.surface).map(usize::from),
                    Origin::Plan,
                ),
                From::Position(slot) => (Some(usize::from(slot)).filter(is_there), Origin::Position),
                From::Found(_) => (free(), Origin::Discovered),
            };
            if let Some(slot) = slot {
                environment.insert_surface(slot, surface.existence, origin);
                environment.set_existence(slot, surface.existence);
            }
            let _ = slots.push(slot.map(|slot| slot as u8));
        }
        let begin_of_blocks = from.clone();
        for row in 0..usize::from(count) {
            for _ in 0..row {
                let _: [f32; 4] = value(&mut from)?;
            }
        }
        // Those that were told and are not in the map gave way there: they come last.
        let told = environment.take_sources();
        let sources: u16 = value(&mut from)?;
        for _ in 0..sources {
            let source = StoredSource::read(&mut from)?;
            let slot_of = |index: u8| slots.get(usize::from(index)).copied().flatten();
            let sequence = slot_of(source.first).and_then(|first| {
                let second = match source.second {
                    None => None,
                    Some(second) => Some(slot_of(second)?),
                };
                Some(Sequence { first, second, is_either_order: source.is_either_order })
            });
            let anchor = usize::from(source.anchor);
            let taken = sequence.is_some_and(|sequence| environment.enter(anchor, sequence, source.hits));
            restored.sources += u32::from(taken);
            restored.sources_left_out += u32::from(!taken);
        }
        for record in told.iter().flatten() {
            environment.enter(record.anchor, record.sequence, record.hits);
        }
        // A surface that was found and that nothing is seen in has no say.
        let mut surfaces = begin_of_surfaces.clone();
        for slot in &mut slots {
            let surface = StoredSurface::read(&mut surfaces)?;
            if let (Some(own), From::Found(_)) = (*slot, surface.from)
                && !environment.iter().any(|(_, record)| record.sequence.has(usize::from(own)))
            {
                environment.remove_surface(usize::from(own));
                *slot = None;
            }
            restored.surfaces += u32::from(slot.is_some());
            restored.surfaces_left_out += u32::from(slot.is_none());
        }
        belief.tell(|filter| {
            let mut surfaces = begin_of_surfaces.clone();
            for slot in &slots {
                let Ok(surface) = StoredSurface::read(&mut surfaces) else { return };
                let Some(slot) = slot.map(usize::from) else { continue };
                let kind = match surface.from {
                    From::Found(Some(line)) => Surface::Wall(line),
                    From::Found(None) => Surface::Private,
                    From::Plan(_) | From::Position(_) => match filter.surface(slot) {
                        Some((kind, ..)) => kind,
                        None => continue,
                    },
                };
                let [first, second] = surface.state;
                filter.restore(slot, kind, Vector2::new(first, second), surface.covariance());
            }
            let mut blocks = begin_of_blocks.clone();
            for (row, own) in slots.iter().enumerate() {
                for other in slots.iter().take(row) {
                    let Ok([m11, m12, m21, m22]) = value::<[f32; 4]>(&mut blocks) else { return };
                    if let (Some(own), Some(other)) = (own, other) {
                        let block = Matrix2::new(m11, m12, m21, m22);
                        filter.restore_block(usize::from(*own), usize::from(*other), &block);
                    }
                }
            }
        });
        transmission.restore(&mut from)?;
        self.seals = self.seals.opened();
        Ok(restored)
    }

    /// Digest of the anchors and of the map told.
    fn map_digest(&self) -> u64 {
        let mut digest = Digest::default();
        self.anchors.len().write(&mut digest);
        self.anchors.iter().for_each(|anchor| anchor.write(&mut digest));
        self.map.write(&mut digest);
        digest.value()
    }

    /// Slots and records of the surfaces that a map has: a heading is none.
    fn mapped(&self) -> impl Iterator<Item = (usize, &SurfaceRecord)> + Clone {
        (0..SURFACES).filter_map(|slot| {
            let (surface, ..) = self.filter().surface(slot)?;
            let is_heading = matches!(surface, Surface::Heading { .. });
            self.environment.surface(slot).filter(|_| !is_heading).map(|record| (slot, record))
        })
    }
}

/// The map of a tracker, to be written.
struct MapWriter<'a, T> {
    tracker: &'a T,
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
    const FRAMES: usize,
> Written
    for MapWriter<
        '_,
        Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES, FRAMES>,
    >
{
    fn write(&self, to: &mut impl Sink) {
        let tracker = self.tracker;
        let filter = tracker.filter();
        (tracker.mapped().count() as u16).write(to);
        for (slot, record) in tracker.mapped() {
            let Some((surface, state, own)) = filter.surface(slot) else { continue };
            let from = match (tracker.plan.wall_of(slot), surface) {
                (Some(wall), _) => From::Plan(wall as u16),
                (None, Surface::Private) if !record.may_join => From::Position(slot as u16),
                (None, Surface::Wall(line)) => From::Found(Some(line)),
                (None, _) => From::Found(None),
            };
            from.write(to);
            [state.x, state.y].write(to);
            [own.m11, own.m21, own.m22].write(to);
            record.existence.write(to);
        }
        for (index, (slot, _)) in tracker.mapped().enumerate() {
            for (other, _) in tracker.mapped().take(index) {
                block_of(filter.block(slot, other)).write(to);
            }
        }
        let place = |slot: usize| tracker.mapped().position(|(own, _)| own == slot).map(|index| index as u8);
        let stored = |record: &Record| {
            let first = place(usize::from(record.sequence.first))?;
            let second = match record.sequence.second {
                None => None,
                Some(second) => Some(place(usize::from(second))?),
            };
            let (anchor, is_either_order) = (record.anchor as u16, record.sequence.is_either_order);
            Some(StoredSource { anchor, first, second, is_either_order, hits: record.hits })
        };
        let sources = || tracker.environment.iter().filter_map(|(_, record)| stored(record));
        (sources().count() as u16).write(to);
        sources().for_each(|source| source.write(to));
        tracker.transmission.write_walls(tracker.plan.walls().len(), to);
    }
}

/// A source of a stored map: the surfaces by their places in it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct StoredSource {
    anchor: u16,
    first: u8,
    second: Option<u8>,
    is_either_order: bool,
    hits: u32,
}

impl StoredSource {
    fn read(from: &mut Reader<'_>) -> Result<Self, SnapshotError> {
        Ok(Self {
            anchor: value(from)?,
            first: value(from)?,
            second: value(from)?,
            is_either_order: value(from)?,
            hits: value(from)?,
        })
    }
}

snapshot::written!(StoredSource { anchor, first, second, is_either_order, hits });

/// The bytes of a map that were read through once, so that nothing is taken over of one that is not sound.
struct StoredMap<'a> {
    body: Reader<'a>,
}

impl<'a> StoredMap<'a> {
    fn check(body: Reader<'a>, anchors: usize) -> Result<Self, SnapshotError> {
        let mut from = body.clone();
        let count: u16 = value(&mut from)?;
        let mut is_sound = usize::from(count) <= MOST;
        for _ in 0..count {
            let StoredSurface { state, own: [m11, m21, m22], existence, .. } =
                StoredSurface::read(&mut from)?;
            is_sound &= state.into_iter().chain([m11, m21, m22]).all(f32::is_finite)
                && m11 >= 0.0
                && m22 >= 0.0
                && crate::real::is_probability(existence);
        }
        for _ in 0..usize::from(count) * usize::from(count).saturating_sub(1) / 2 {
            let block: [f32; 4] = value(&mut from)?;
            is_sound &= block.into_iter().all(f32::is_finite);
        }
        let sources: u16 = value(&mut from)?;
        for _ in 0..sources {
            let StoredSource { anchor, first, second, .. } = StoredSource::read(&mut from)?;
            let is_surface = |index: u8| u16::from(index) < count;
            is_sound &= usize::from(anchor) < anchors && is_surface(first) && second.is_none_or(is_surface);
        }
        // What walls let through ends it.
        let walls: u16 = value(&mut from)?;
        for _ in 0..usize::from(walls) + 1 {
            let looks: [f32; 2] = value(&mut from)?;
            is_sound &= looks.into_iter().all(|seconds| seconds.is_finite() && seconds >= 0.0);
        }
        if is_sound && from.is_empty() { Ok(Self { body }) } else { Err(SnapshotError::Damaged) }
    }

    fn body(&self) -> Reader<'a> {
        self.body.clone()
    }
}
