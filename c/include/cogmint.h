/* The cogmint tracker in C. Made of the sources in c/src by c/header.sh: do not edit.
 *
 * cogmint_config_pedestrian (or another preset), cogmint_start; then per cycle cogmint_begin, cogmint_receive_frame or
 * cogmint_receive_ranges per anchor, cogmint_finish. docs/c.md says more.
 */

#ifndef COGMINT_H
#define COGMINT_H

#include <stddef.h>
#include <stdint.h>

/* Of the library built with the feature `ranges`, COGMINT_RANGES is to be defined. */
#if UINTPTR_MAX == 0xffffffff
#define COGMINT_POINTER_BITS_32
#else
#define COGMINT_POINTER_BITS_64
#endif

/**
 * Bytes of cogmint_report.
 */
#define COGMINT_REPORT_SIZE 140

#if !defined(COGMINT_RANGES)
/**
 * Anchors at most.
 */
#define COGMINT_MOST_ANCHORS 2
#endif

#if defined(COGMINT_RANGES)
/**
 * Anchors at most.
 */
#define COGMINT_MOST_ANCHORS 4
#endif

/**
 * Surfaces at most: walls, and virtual anchors whose walls are not known.
 */
#define COGMINT_MOST_SURFACES 8

#if !defined(COGMINT_RANGES)
/**
 * Sources at most: virtual anchors told, found or shown by the walls.
 */
#define COGMINT_MOST_SOURCES 24
#endif

#if defined(COGMINT_RANGES)
/**
 * Sources at most: virtual anchors told, found or shown by the walls.
 */
#define COGMINT_MOST_SOURCES 12
#endif

/**
 * Walls, segments of walls and corners of the outline at most, of each.
 */
#define COGMINT_MOST_SEGMENTS 32

#if !defined(COGMINT_RANGES)
/**
 * Paths or ranges of an anchor that a cycle keeps; what is received beyond them is counted and left out.
 */
#define COGMINT_MOST_PATHS 16
#endif

#if defined(COGMINT_RANGES)
/**
 * Paths or ranges of an anchor that a cycle keeps; what is received beyond them is counted and left out.
 */
#define COGMINT_MOST_PATHS 8
#endif

#if !defined(COGMINT_RANGES)
/**
 * Actions (carriers and pulses) at most.
 */
#define COGMINT_MOST_ACTIONS 40
#endif

#if defined(COGMINT_RANGES)
/**
 * Actions (carriers and pulses) at most.
 */
#define COGMINT_MOST_ACTIONS 6
#endif

/**
 * Places where the tag may be that are followed at a time, at most.
 */
#define COGMINT_MOST_COMPONENTS 8

#if !defined(COGMINT_RANGES)
/**
 * Points of what paths leave of a frame: 0 where frames are read no further than to their paths.
 */
#define COGMINT_MOST_POINTS 800
#endif

#if defined(COGMINT_RANGES)
/**
 * Points of what paths leave of a frame: 0 where frames are read no further than to their paths.
 */
#define COGMINT_MOST_POINTS 0
#endif

/**
 * Candidates for virtual anchors that nobody told of, per anchor, at most.
 */
#define COGMINT_MOST_CANDIDATES 6

/**
 * Ranges that one call of cogmint_receive_ranges takes at most.
 */
#define COGMINT_MOST_RANGES 64

/**
 * Samples of a window of the accumulator at most.
 */
#define COGMINT_MOST_CIR_SAMPLES 256

/**
 * Samples of a pulse's autocorrelation.
 */
#define COGMINT_PULSE_SAMPLES 33

#if (!defined(COGMINT_RANGES) && defined(COGMINT_POINTER_BITS_32))
/**
 * Bytes of memory that a tracker is sure to fit in. cogmint_tracker_size() tells how many it takes.
 */
#define COGMINT_TRACKER_SIZE 41984
#endif

#if (!defined(COGMINT_RANGES) && defined(COGMINT_POINTER_BITS_64))
/**
 * Bytes of memory that a tracker is sure to fit in. cogmint_tracker_size() tells how many it takes.
 */
#define COGMINT_TRACKER_SIZE 42496
#endif

#if (defined(COGMINT_RANGES) && defined(COGMINT_POINTER_BITS_32))
/**
 * Bytes of memory that a tracker is sure to fit in. cogmint_tracker_size() tells how many it takes.
 */
#define COGMINT_TRACKER_SIZE 50944
#endif

#if (defined(COGMINT_RANGES) && defined(COGMINT_POINTER_BITS_64))
/**
 * Bytes of memory that a tracker is sure to fit in. cogmint_tracker_size() tells how many it takes.
 */
#define COGMINT_TRACKER_SIZE 51968
#endif

/**
 * Alignment of that memory, bytes.
 */
#define COGMINT_TRACKER_ALIGN 8

/**
 * No index: of `rendezvous`, and of `announced_action` in a report.
 */
#define COGMINT_NO_INDEX 4294967295

/**
 * Bytes of cogmint_config.
 */
#define COGMINT_CONFIG_SIZE 268

/**
 * Why a call was refused. A call that is refused has changed nothing but what its description says.
 */
enum cogmint_error
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * Nothing is wrong.
   */
  COGMINT_ERROR_NONE = 0,
  /**
   * A pointer is NULL that must not be.
   */
  COGMINT_ERROR_NULL_POINTER = 1,
  /**
   * A pointer is not aligned as its type needs.
   */
  COGMINT_ERROR_ALIGNMENT = 2,
  /**
   * The memory is smaller than cogmint_tracker_size().
   */
  COGMINT_ERROR_MEMORY_SIZE = 3,
  /**
   * A count, or an index, is larger than anything that fits in memory.
   */
  COGMINT_ERROR_COUNT = 4,
  /**
   * A profile, a radio, a kind of samples or a format that there is not.
   */
  COGMINT_ERROR_UNKNOWN_CHOICE = 5,
  /**
   * No anchor, or more than COGMINT_MOST_ANCHORS.
   */
  COGMINT_ERROR_ANCHOR_COUNT = 20,
  /**
   * More virtual anchors than there are surfaces or sources.
   */
  COGMINT_ERROR_VIRTUAL_ANCHOR_COUNT = 21,
  /**
   * The position of an anchor or virtual anchor, or its deviation, is out of range.
   */
  COGMINT_ERROR_GEOMETRY = 22,
  /**
   * More walls, segments or corners than COGMINT_MOST_SEGMENTS.
   */
  COGMINT_ERROR_PLAN_SIZE = 23,
  /**
   * The plan's turn or its number of reflections is out of range.
   */
  COGMINT_ERROR_PLAN_SETTINGS = 24,
  /**
   * A wall of the plan has no segment, or a deviation out of range.
   */
  COGMINT_ERROR_PLAN_WALL = 25,
  /**
   * A segment of the plan is out of range, without length, of no wall or off its wall's line.
   */
  COGMINT_ERROR_PLAN_SEGMENT = 26,
  /**
   * A corner of the outline is out of range, or there are fewer than three.
   */
  COGMINT_ERROR_PLAN_OUTLINE = 27,
  /**
   * A cycle is begun that was not finished.
   */
  COGMINT_ERROR_ALREADY_BEGUN = 40,
  /**
   * No cycle is begun.
   */
  COGMINT_ERROR_NOT_BEGUN = 41,
  /**
   * The tracker is not started.
   */
  COGMINT_ERROR_NOT_STARTED = 42,
  /**
   * There is no such anchor.
   */
  COGMINT_ERROR_UNKNOWN_ANCHOR = 43,
  /**
   * There is no such action.
   */
  COGMINT_ERROR_UNKNOWN_ACTION = 44,
  /**
   * A second frame or scan of an anchor in one cycle, or the sequence number of its last frame again.
   */
  COGMINT_ERROR_DUPLICATE_FRAME = 45,
  /**
   * The time elapsed is not above 0 and at most an hour.
   */
  COGMINT_ERROR_TIME = 46,
  /**
   * A frame with another number of samples than configured.
   */
  COGMINT_ERROR_FRAME_LENGTH = 47,
  /**
   * A sample is NaN, infinite or beyond 1e12.
   */
  COGMINT_ERROR_SAMPLE_NOT_FINITE = 48,
  /**
   * All samples of a frame are zero.
   */
  COGMINT_ERROR_SILENT_FRAME = 49,
  /**
   * Samples stand at the converter's full scale.
   */
  COGMINT_ERROR_SATURATED_FRAME = 50,
  /**
   * A magnitude is below zero.
   */
  COGMINT_ERROR_NEGATIVE_MAGNITUDE = 51,
  /**
   * The delay of a frame's first sample is not finite or beyond the longest range.
   */
  COGMINT_ERROR_FRAME_DELAY = 52,
  /**
   * A range is not finite, not positive, or beyond the longest range.
   */
  COGMINT_ERROR_RANGE = 53,
  /**
   * A range's variance is not finite, or not within (1 mm)^2 to (100 m)^2.
   */
  COGMINT_ERROR_RANGE_VARIANCE = 54,
  /**
   * More than COGMINT_MOST_RANGES ranges.
   */
  COGMINT_ERROR_RANGE_COUNT = 55,
  /**
   * The tag's height or its deviation is out of range.
   */
  COGMINT_ERROR_TAG_HEIGHT = 56,
  /**
   * The antenna's lever arm is out of range, or no heading is estimated.
   */
  COGMINT_ERROR_LEVER_ARM = 57,
  /**
   * Something else that is refused.
   */
  COGMINT_ERROR_REFUSED = 58,
  /**
   * A bit has flipped in what the tracker was told: start it anew.
   */
  COGMINT_ERROR_TOLD_CHANGED = 59,
  /**
   * The buffer is too short for the snapshot; the bytes needed were written to `length`.
   */
  COGMINT_ERROR_SNAPSHOT_ROOM = 70,
  /**
   * The bytes are no snapshot, or one that is cut short.
   */
  COGMINT_ERROR_SNAPSHOT_FOREIGN = 71,
  /**
   * A snapshot of another version of its format.
   */
  COGMINT_ERROR_SNAPSHOT_VERSION = 72,
  /**
   * A snapshot of a tracker that was told something else, or that has other capacities; a map of other anchors or of another map told.
   */
  COGMINT_ERROR_SNAPSHOT_TOLD = 73,
  /**
   * The snapshot is damaged.
   */
  COGMINT_ERROR_SNAPSHOT_DAMAGED = 74,
  /**
   * The first-path index is NaN, negative, or 1024 or more.
   */
  COGMINT_ERROR_CIR_INDEX = 80,
  /**
   * The window has no sample, more than COGMINT_MOST_CIR_SAMPLES, or more than there is room for.
   */
  COGMINT_ERROR_CIR_LENGTH = 81,
  /**
   * The window begins ahead of the accumulator, or of the samples given.
   */
  COGMINT_ERROR_CIR_OUTSIDE = 82,
  /**
   * The bytes of the accumulator end before the window does.
   */
  COGMINT_ERROR_CIR_BYTES = 83,
  /**
   * Two time stamps of one clock are in the wrong order, or 8.6 s or more apart.
   */
  COGMINT_ERROR_TWO_WAY_ORDER = 90,
  /**
   * The clock offset is NaN or beyond 1e-4.
   */
  COGMINT_ERROR_TWO_WAY_OFFSET = 91,
  /**
   * A round takes no longer than the antenna delay in it.
   */
  COGMINT_ERROR_TWO_WAY_DELAY = 92,
  /**
   * The time stamps make a range that is not positive, or beyond 10 km.
   */
  COGMINT_ERROR_TWO_WAY_RANGE = 93,
  /**
   * A setting is out of range that cogmint_config does not have.
   */
  COGMINT_ERROR_SETTING = 100,
  /**
   * `acceleration_density_m2_s3` is out of range.
   */
  COGMINT_ERROR_SETTING_ACCELERATION = 101,
  /**
   * `velocity_decay_s` is out of range.
   */
  COGMINT_ERROR_SETTING_VELOCITY_DECAY = 102,
  /**
   * `start_position_m` is out of range.
   */
  COGMINT_ERROR_SETTING_START_POSITION = 103,
  /**
   * `start_position_std_m` or `start_velocity_std_m_s` is out of range.
   */
  COGMINT_ERROR_SETTING_START_DEVIATION = 104,
  /**
   * `has_heading`: there is no surface to spare for it.
   */
  COGMINT_ERROR_SETTING_HEADING = 105,
  /**
   * `range_variance_inflation` is out of range.
   */
  COGMINT_ERROR_SETTING_RANGE_INFLATION = 106,
  /**
   * `range_floor_m` or `path_floor_pulses` is out of range.
   */
  COGMINT_ERROR_SETTING_RANGE_FLOOR = 107,
  /**
   * `bias_mean_m` or `bias_std_m` is out of range.
   */
  COGMINT_ERROR_SETTING_BIAS = 108,
  /**
   * `late_m` is out of range.
   */
  COGMINT_ERROR_SETTING_LATENESS = 109,
  /**
   * `max_range_m` is out of range.
   */
  COGMINT_ERROR_SETTING_MAX_RANGE = 110,
  /**
   * `detection_probability` is out of range.
   */
  COGMINT_ERROR_SETTING_DETECTION = 111,
  /**
   * `clutter_per_anchor` is out of range.
   */
  COGMINT_ERROR_SETTING_CLUTTER = 112,
  /**
   * `pulse_roll_off` is out of range.
   */
  COGMINT_ERROR_SETTING_ROLL_OFF = 113,
  /**
   * `pulse_step_s` or `pulse_autocorrelation` is out of range, or `pulse_samples` neither 0 nor COGMINT_PULSE_SAMPLES.
   */
  COGMINT_ERROR_SETTING_PULSE = 114,
  /**
   * `sample_spacing_s` is out of range.
   */
  COGMINT_ERROR_SETTING_SAMPLE_SPACING = 115,
  /**
   * `samples_per_frame` is out of range.
   */
  COGMINT_ERROR_SETTING_SAMPLE_COUNT = 116,
  /**
   * `full_scale` is out of range.
   */
  COGMINT_ERROR_SETTING_FULL_SCALE = 117,
  /**
   * `false_paths_per_frame` is out of range.
   */
  COGMINT_ERROR_SETTING_FALSE_PATHS = 118,
  /**
   * `first_action` is no index of an action.
   */
  COGMINT_ERROR_SETTING_FIRST_ACTION = 119,
  /**
   * `rendezvous` is no index of an action.
   */
  COGMINT_ERROR_SETTING_RENDEZVOUS = 120,
  /**
   * `planned_actions` is out of range.
   */
  COGMINT_ERROR_SETTING_PLANNED_ACTIONS = 121,
  /**
   * `horizon` is out of range.
   */
  COGMINT_ERROR_SETTING_HORIZON = 122,
  /**
   * No action, or more than COGMINT_MOST_ACTIONS.
   */
  COGMINT_ERROR_ACTION_COUNT = 123,
  /**
   * The carrier of an action is out of range.
   */
  COGMINT_ERROR_ACTION_CARRIER = 124,
  /**
   * The pulse duration of an action is out of range.
   */
  COGMINT_ERROR_ACTION_PULSE = 125,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum cogmint_error cogmint_error;
#else
typedef uint32_t cogmint_error;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Who carries the tag: where all settings come from that are not in cogmint_config.
 */
enum cogmint_profile
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * The published set-up: 1 cm per cycle, in a room.
   */
  COGMINT_PROFILE_PUBLISHED = 0,
  /**
   * Somebody who walks.
   */
  COGMINT_PROFILE_PEDESTRIAN = 1,
  /**
   * A robot on wheels, at 0.3 to 0.8 m/s.
   */
  COGMINT_PROFILE_ROBOT = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum cogmint_profile cogmint_profile;
#else
typedef uint32_t cogmint_profile;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A radio.
 */
enum cogmint_radio
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * The published channel sounder: 2 GHz of band, frames and no ranges.
   */
  COGMINT_RADIO_SOUNDER = 0,
  /**
   * DW1000.
   */
  COGMINT_RADIO_DW1000 = 1,
  /**
   * DW3000.
   */
  COGMINT_RADIO_DW3000 = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum cogmint_radio cogmint_radio;
#else
typedef uint32_t cogmint_radio;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What samples are.
 */
enum cogmint_samples
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * In-phase part and quadrature, two numbers per sample.
   */
  COGMINT_SAMPLES_COMPLEX = 0,
  /**
   * Amplitude alone, one number per sample, not negative.
   */
  COGMINT_SAMPLES_MAGNITUDE = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum cogmint_samples cogmint_samples;
#else
typedef uint32_t cogmint_samples;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * How an accumulator stores a sample: in-phase part, then quadrature, each little-endian in two's complement.
 */
enum cogmint_accumulator
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * 16 bits each, 4 bytes per sample: DW1000.
   */
  COGMINT_ACCUMULATOR_BITS16 = 16,
  /**
   * 24 bits each, 6 bytes per sample: DW3000.
   */
  COGMINT_ACCUMULATOR_BITS24 = 24,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum cogmint_accumulator cogmint_accumulator;
#else
typedef uint32_t cogmint_accumulator;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A tracker, in the memory that cogmint_start was given.
 */
typedef struct cogmint_tracker cogmint_tracker;

/**
 * The settings that users touch. To be filled by cogmint_config_published, _pedestrian or _robot, then changed field by field.
 * What it does not have is as the preset of `profile` and `radio` has it.
 */
typedef struct cogmint_config {
  /**
   * A cogmint_profile. As filled.
   */
  uint32_t profile;
  /**
   * A cogmint_radio. As filled.
   */
  uint32_t radio;
  /**
   * Where the tag starts, metres (within 10 km of the origin).
   */
  float start_position_m[2];
  /**
   * Its standard deviation per axis, metres (1e-3 to 1e3).
   */
  float start_position_std_m;
  /**
   * Standard deviation of the first velocity per axis around zero, m/s (1e-3 to 1e3).
   */
  float start_velocity_std_m_s;
  /**
   * Spectral density of the acceleration per axis, m^2/s^3 (1e-12 to 1e4). Larger follows turns faster and averages less.
   */
  float acceleration_density_m2_s3;
  /**
   * Time constant with which a velocity decays to zero, seconds (at least 0.1).
   */
  float velocity_decay_s;
  /**
   * Not 0: antennas beside the centre of the tag's body take turns, and its heading is estimated.
   */
  uint32_t has_heading;
  /**
   * Factor on every measurement variance (1 to 100).
   */
  float range_variance_inflation;
  /**
   * Standard deviation that no range goes below, metres (1e-3 to 10).
   */
  float range_floor_m;
  /**
   * The same for paths of frames, pulse lengths (0 to 1), on top.
   */
  float path_floor_pulses;
  /**
   * Mean of the bias expected of every anchor's ranges, metres (-10 to 10).
   */
  float bias_mean_m;
  /**
   * Its standard deviation, metres (0 to 10). Above 0, one bias per anchor is estimated.
   */
  float bias_std_m;
  /**
   * By how much ranges are too long on average whose direct path is blocked, metres (0 to 100). 0: no range is late.
   */
  float late_m;
  /**
   * Ranges beyond this are refused, metres (1 to 1e4).
   */
  float max_range_m;
  /**
   * Probability that what is there is detected (0.01 to 0.999).
   */
  float detection_probability;
  /**
   * False ranges per anchor and cycle (1e-3 to 100).
   */
  float clutter_per_anchor;
  /**
   * Not 0: unknown virtual anchors are looked for.
   */
  uint32_t has_discovery;
  /**
   * Time between two samples of a frame, seconds (0.01e-9 to 10e-9).
   */
  float sample_spacing_s;
  /**
   * Samples of a frame (16 to 4096).
   */
  uint32_t samples_per_frame;
  /**
   * Full scale of the converter in the unit of the samples: frames that reach it are refused. 0: it has none.
   */
  float full_scale;
  /**
   * Not 0: the receiver scales every frame as it likes.
   */
  uint32_t has_gain_control;
  /**
   * False paths per frame in pure noise (1e-4 to 10). More finds weaker paths and more phantoms.
   */
  float false_paths_per_frame;
  /**
   * Not 0: dense multipath begins with a path, as of real radios in flats and halls.
   */
  uint32_t dense_begins_with_path;
  /**
   * 0: the pulse has `pulse_roll_off`. COGMINT_PULSE_SAMPLES: it has `pulse_step_s` and `pulse_autocorrelation`.
   */
  uint32_t pulse_samples;
  /**
   * Roll-off of a root-raised-cosine pulse (0 to 1).
   */
  float pulse_roll_off;
  /**
   * Time between two samples of the autocorrelation, seconds (1e-12 to 1e-8).
   */
  float pulse_step_s;
  /**
   * Autocorrelation of the pulse, from lag zero on, where it is 1.
   */
  float pulse_autocorrelation[COGMINT_PULSE_SAMPLES];
  /**
   * Index of the action of the first cycle.
   */
  uint32_t first_action;
  /**
   * Actions planned per cycle (0: the radio never leaves its action).
   */
  uint32_t planned_actions;
  /**
   * Cycles that are planned ahead (1 to 16).
   */
  uint32_t horizon;
  /**
   * Index of the action to go to after three lost frames: every choice is then announced one cycle before it is used.
   * COGMINT_NO_INDEX: there is none, and choices are used at once.
   */
  uint32_t rendezvous;
  /**
   * Work for each anchor that is heard in a cycle, about in instructions of a Cortex-M4F (20,000 to 1e9): half of it at most goes into
   * looking for the paths of its frame, and what frames leave into comparing places with what was heard.
   */
  uint32_t anchor_work;
  /**
   * Comparisons of places with what an anchor delivered, per cycle at most (1 to 65,535), with two places at least.
   */
  uint32_t comparisons;
} cogmint_config;

/**
 * An anchor.
 */
typedef struct cogmint_anchor {
  /**
   * Horizontal position, metres (within 10 km of the origin).
   */
  float position_m[2];
  /**
   * Height, metres (within 1 km). Counts only in cycles whose tag height is given.
   */
  float height_m;
} cogmint_anchor;

/**
 * The image of an anchor in a wall, told by its position.
 */
typedef struct cogmint_virtual_anchor {
  /**
   * Index of the anchor.
   */
  uint32_t anchor;
  /**
   * Position of the image, metres.
   */
  float position_m[2];
  /**
   * Its standard deviation per axis, metres (1e-4 to 100; 0: it is exactly there).
   */
  float std_m;
} cogmint_virtual_anchor;

/**
 * A wall: how far it may be from where it is told. 0 and 0: it is exactly there.
 */
typedef struct cogmint_wall {
  /**
   * Standard deviation of its offset along its normal, metres (0, or 1e-4 to 100).
   */
  float offset_std_m;
  /**
   * Standard deviation of its rotation about its centre, radians (0, or 1e-6 to 1).
   */
  float rotation_std_rad;
} cogmint_wall;

/**
 * A segment of a wall. All segments of a wall are on one line.
 */
typedef struct cogmint_segment {
  /**
   * Index of its wall.
   */
  uint32_t wall;
  /**
   * Both ends, metres: x and y of the one, then of the other.
   */
  float ends_m[2][2];
} cogmint_segment;

/**
 * A floor plan.
 */
typedef struct cogmint_plan {
  /**
   * Corners of the outline in order, metres: the tag is inside. NULL and 0 where there is none.
   */
  const float (*outline_m)[2];
  /**
   * How many corners.
   */
  size_t corner_count;
  /**
   * The walls, those of the outline among them.
   */
  const struct cogmint_wall *walls;
  /**
   * How many walls.
   */
  size_t wall_count;
  /**
   * What the walls consist of.
   */
  const struct cogmint_segment *segments;
  /**
   * How many segments.
   */
  size_t segment_count;
  /**
   * Standard deviation of the angle by which the plan as a whole may be turned, radians (0 to 1).
   */
  float turn_std_rad;
  /**
   * Reflections per path that are followed: 0 to 2.
   */
  uint32_t reflections;
  /**
   * Images that are listed at most; no more than fit are.
   */
  uint32_t most_sources;
} cogmint_plan;

/**
 * What is known of the surroundings before the start.
 */
typedef struct cogmint_map {
  /**
   * Virtual anchors whose walls are not known. NULL and 0 where there is none.
   */
  const struct cogmint_virtual_anchor *virtual_anchors;
  /**
   * How many virtual anchors.
   */
  size_t virtual_anchor_count;
  /**
   * The floor plan, or NULL.
   */
  const struct cogmint_plan *plan;
} cogmint_map;

/**
 * What the radio can be told.
 */
typedef struct cogmint_action {
  /**
   * Carrier frequency, hertz (0.1e9 to 100e9).
   */
  float carrier_hz;
  /**
   * Pulse duration, seconds (0.1e-9 to 10e-9).
   */
  float pulse_duration_s;
} cogmint_action;

/**
 * The tag's height.
 */
typedef struct cogmint_tag_height {
  /**
   * Mean, metres.
   */
  float mean_m;
  /**
   * Standard deviation, metres (0 to 100).
   */
  float std_m;
} cogmint_tag_height;

/**
 * A frame: one received channel impulse response.
 */
typedef struct cogmint_frame {
  /**
   * Index of the anchor.
   */
  uint32_t anchor;
  /**
   * Index of the action that it was received with.
   */
  uint32_t action;
  /**
   * Not 0: `sequence` counts. The anchor's last value again is refused as a duplicate.
   */
  uint32_t has_sequence;
  /**
   * The radio's frame counter.
   */
  uint32_t sequence;
  /**
   * Propagation delay that the first sample stands for, seconds; may be negative.
   */
  float first_sample_delay_s;
  /**
   * A cogmint_samples.
   */
  uint32_t kind;
  /**
   * The numbers.
   */
  const float *samples;
  /**
   * How many samples: half as many as numbers where they are complex.
   */
  size_t sample_count;
} cogmint_frame;

/**
 * A range that somebody else estimated.
 */
typedef struct cogmint_range {
  /**
   * Distance, metres.
   */
  float range_m;
  /**
   * Variance, square metres ((1 mm)^2 to (100 m)^2).
   */
  float variance_m2;
} cogmint_range;

/**
 * What a cycle did.
 */
typedef struct cogmint_report {
  /**
   * Number of the cycle, from 0.
   */
  uint32_t cycle;
  /**
   * Position, metres: of the leading place.
   */
  float position_m[2];
  /**
   * Its covariance over all places that the tag may be at, square metres: of xx, xy, yy.
   */
  float position_covariance_m2[3];
  /**
   * Velocity, m/s. Meaningless while `searching`.
   */
  float velocity_m_s[2];
  /**
   * Its covariance, m^2/s^2: of xx, xy, yy.
   */
  float velocity_covariance_m2_s2[3];
  /**
   * Probability that the tag is at the leading place.
   */
  float probability;
  /**
   * Entropy of the position before the measurements, nats.
   */
  float predicted_entropy_nat;
  /**
   * And after.
   */
  float entropy_nat;
  /**
   * Reward of the action applied.
   */
  float reward;
  /**
   * Mean normalised innovation squared of the ranges associated: near 1 where the filter knows how wrong it is.
   */
  float nis;
  /**
   * Anchors heard.
   */
  uint32_t anchors_heard;
  /**
   * Paths or ranges received and kept.
   */
  uint32_t measurements;
  /**
   * Paths or ranges left out because no more than COGMINT_MOST_PATHS are kept.
   */
  uint32_t left_out;
  /**
   * What the cycle has cost, about in instructions of a Cortex-M4F.
   */
  uint32_t work;
  /**
   * Frames whose estimate was ended for its work: weak paths may be missing.
   */
  uint32_t cut_short;
  /**
   * Places that counted and found no room among those that are followed.
   */
  uint32_t crowded_out;
  /**
   * Of the measurements, how many belong to something known.
   */
  uint32_t associated;
  /**
   * 1 while it is not known where the tag is.
   */
  uint32_t searching;
  /**
   * 1 where that is so since this cycle.
   */
  uint32_t lost;
  /**
   * Virtual anchors discovered in this cycle.
   */
  uint32_t discovered;
  /**
   * Virtual anchors forgotten in this cycle.
   */
  uint32_t forgotten;
  /**
   * Discoveries dropped because the map was full.
   */
  uint32_t map_full;
  /**
   * Index of the action applied.
   */
  uint32_t action;
  /**
   * Index of the next action.
   */
  uint32_t next_action;
  /**
   * Index of the action after that, which the next frame is to announce; COGMINT_NO_INDEX where nothing is announced.
   */
  uint32_t announced_action;
  /**
   * The next action.
   */
  struct cogmint_action next;
  /**
   * Parts of the state in which a bit has flipped, one bit each; 0 where all is as it was.
   */
  uint32_t flipped;
  /**
   * Parts that were reset because of that.
   */
  uint32_t reset;
} cogmint_report;

/**
 * What of a map there was room for.
 */
typedef struct cogmint_map_restored {
  /**
   * Surfaces taken over.
   */
  uint32_t surfaces;
  /**
   * Surfaces left out: there is no room for them, or for any source that is seen in them.
   */
  uint32_t surfaces_left_out;
  /**
   * Sources taken over.
   */
  uint32_t sources;
  /**
   * Sources left out: there is no room for them, or for a surface that they are seen in.
   */
  uint32_t sources_left_out;
} cogmint_map_restored;

/**
 * A channel impulse response as the radio has it.
 */
typedef struct cogmint_cir {
  /**
   * Bytes of the accumulator, without the byte that a DW1000 sends ahead.
   */
  const uint8_t *bytes;
  /**
   * How many.
   */
  size_t byte_count;
  /**
   * Index in the accumulator of the sample that the bytes begin with: what cogmint_cir_first_sample says where the window alone
   * was read, 0 where all was.
   */
  uint32_t first_sample;
  /**
   * A cogmint_accumulator.
   */
  uint32_t format;
  /**
   * The radio's first-path index, samples: cogmint_first_path_index of its register.
   */
  float first_path_index;
  /**
   * Samples ahead of the first path that are kept; 32 are usual.
   */
  uint32_t samples_before;
  /**
   * Samples from it on that are kept; 96 are usual.
   */
  uint32_t samples_after;
  /**
   * Index of the anchor.
   */
  uint32_t anchor;
  /**
   * Index of the action that it was received with.
   */
  uint32_t action;
  /**
   * Length of the first path as ranging has it, metres.
   */
  float first_path_range_m;
  /**
   * By how many samples the pulse's maximum comes behind the index; 2.0 to begin with.
   */
  float peak_after_first_path_samples;
} cogmint_cir;

/**
 * Time stamps of a two-way exchange, ticks of 1 / (128 x 499.2 MHz) of which the lowest 40 bits count.
 */
typedef struct cogmint_two_way {
  /**
   * When the initiator sent the poll, by its clock.
   */
  uint64_t poll_sent;
  /**
   * When the responder received it, by its own.
   */
  uint64_t poll_received;
  /**
   * When the responder sent the response.
   */
  uint64_t response_sent;
  /**
   * When the initiator received it.
   */
  uint64_t response_received;
  /**
   * When the initiator sent the final. Double-sided alone.
   */
  uint64_t final_sent;
  /**
   * When the responder received it. Double-sided alone.
   */
  uint64_t final_received;
  /**
   * Antenna delays of the initiator, transmission and reception together, ticks; 0 where its stamps are corrected.
   */
  uint32_t initiator_delay_ticks;
  /**
   * The same of the responder.
   */
  uint32_t responder_delay_ticks;
  /**
   * Rate of the responder's clock over that of the initiator's, minus 1 (at most 1e-4 either way). Single-sided alone.
   */
  float responder_clock_offset;
} cogmint_two_way;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Bytes of memory that a tracker takes: at most COGMINT_TRACKER_SIZE.
 */
size_t cogmint_tracker_size(void);

/**
 * Alignment of that memory, bytes: at most COGMINT_TRACKER_ALIGN.
 */
size_t cogmint_tracker_align(void);

/**
 * Starts a tracker in `memory`, which holds `length` bytes, and writes it to `tracker`. The memory is the tracker's from then on; the tracker
 * needs no end: the memory may be used for something else, or be started in again, at any time. Everything else is copied and may
 * go. `map` may be NULL: nothing is known of the surroundings. `actions` may be NULL with a count of 0: those of the configuration's
 * radio. `seed`: of all randomness.
 *
 * Where it is refused, `tracker` is not written to, and what the memory holds means nothing.
 *
 * # Safety
 * All pointers are of what their types say, in the numbers told, or NULL; nothing else uses the memory.
 */
cogmint_error cogmint_start(void *memory,
                            size_t length,
                            const struct cogmint_config *config,
                            const struct cogmint_anchor *anchors,
                            size_t anchor_count,
                            const struct cogmint_map *map,
                            const struct cogmint_action *actions,
                            size_t action_count,
                            uint64_t seed,
                            struct cogmint_tracker **tracker);

/**
 * Tells the range bias of one anchor, before the first cycle: its mean (-10 to 10 m) and standard deviation (0 to 10 m; 0 where it is
 * known exactly). Without, it is that of the configuration.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL.
 */
cogmint_error cogmint_tell_range_bias(struct cogmint_tracker *tracker,
                                      uint32_t anchor,
                                      float mean_m,
                                      float std_m);

/**
 * From now on everything is received with an antenna that is this far ahead of the centre of the tag's body, and to its left, metres.
 * Between two cycles.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL.
 */
cogmint_error cogmint_switch_antenna(struct cogmint_tracker *tracker,
                                     float ahead_m,
                                     float left_m);

/**
 * Begins a cycle of the last `elapsed_s` seconds (above 0, at most an hour). `tag_height`: NULL where it is not known.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; `tag_height` may be read, or is NULL.
 */
cogmint_error cogmint_begin(struct cogmint_tracker *tracker,
                            float elapsed_s,
                            const struct cogmint_tag_height *tag_height);

/**
 * Takes a frame of the cycle begun: one of each anchor. The samples are not needed any more afterwards.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; `frame` and its samples may be read, or are NULL.
 */
cogmint_error cogmint_receive_frame(struct cogmint_tracker *tracker, const struct cogmint_frame *frame);

/**
 * Takes all ranges of an anchor in the cycle begun: at most COGMINT_MOST_RANGES, in one call per anchor.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; so many `ranges` may be read, or they are NULL.
 */
cogmint_error cogmint_receive_ranges(struct cogmint_tracker *tracker,
                                     uint32_t anchor,
                                     const struct cogmint_range *ranges,
                                     size_t range_count);

/**
 * Ends the cycle begun, by what was received since, and writes what was made of it to `report`.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; `report` may be written to, or is NULL.
 */
cogmint_error cogmint_finish(struct cogmint_tracker *tracker, struct cogmint_report *report);

/**
 * Writes a hash over all state to `hash`: the same on every machine after the same input.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; `hash` may be written to, or is NULL.
 */
cogmint_error cogmint_hash(const struct cogmint_tracker *tracker, uint64_t *hash);

/**
 * Writes the state between two cycles to `buffer`, which has room for `*length` bytes, and the bytes of the snapshot to `length`. What the tracker
 * was told at the start is not in it. With a NULL buffer and a length of 0, COGMINT_ERROR_SNAPSHOT_ROOM and the bytes needed.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; `buffer` and `length` may be written to, or are NULL.
 */
cogmint_error cogmint_snapshot(const struct cogmint_tracker *tracker,
                               uint8_t *buffer,
                               size_t *length);

/**
 * Goes on from a snapshot: of a tracker that was started with the same, between two cycles. What follows it in `bytes` does no harm.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; so many `bytes` may be read, or they are NULL.
 */
cogmint_error cogmint_restore(struct cogmint_tracker *tracker,
                              const uint8_t *bytes,
                              size_t length);

/**
 * Writes the map alone between two cycles to `buffer`, which has room for `*length` bytes, and its bytes to `length`: what was learnt of walls
 * and virtual anchors. Unlike a snapshot it outlives other settings, actions and capacities. With a NULL buffer and a length of 0,
 * COGMINT_ERROR_SNAPSHOT_ROOM and the bytes needed.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; `buffer` and `length` may be written to, or are NULL.
 */
cogmint_error cogmint_map_snapshot(const struct cogmint_tracker *tracker,
                                   uint8_t *buffer,
                                   size_t *length);

/**
 * Takes over a map: before the first cycle of a tracker that was started with the same anchors and the same map, whatever else is
 * another. What follows it in `bytes` does no harm. Writes to `restored` what there was room for, where that is not NULL.
 *
 * COGMINT_ERROR_SNAPSHOT_TOLD: of other anchors or another map told; COGMINT_ERROR_ALREADY_BEGUN: after the first cycle was begun. Nothing
 * has changed then.
 *
 * # Safety
 * `tracker` is a tracker that was started, or NULL; so many `bytes` may be read, or they are NULL; `restored` may be written to, or is NULL.
 */
cogmint_error cogmint_map_restore(struct cogmint_tracker *tracker,
                                  const uint8_t *bytes,
                                  size_t length,
                                  struct cogmint_map_restored *restored);

/**
 * What unwinding would call, of which the compiler's own functions for hosts speak. Nothing unwinds.
 */
void rust_eh_personality(void);

/**
 * Fills in the published set-up, with the channel sounder.
 *
 * # Safety
 * `config`: of a cogmint_config that may be written to, or NULL.
 */
cogmint_error cogmint_config_published(struct cogmint_config *config);

/**
 * Fills in somebody who walks indoors, with this cogmint_radio. `start_position_m` is the user's: the middle of the room, say.
 *
 * # Safety
 * `config`: of a cogmint_config that may be written to, or NULL.
 */
cogmint_error cogmint_config_pedestrian(struct cogmint_config *config,
                                        uint32_t radio);

/**
 * Fills in a robot on wheels, at 0.3 to 0.8 m/s, with this cogmint_radio.
 *
 * # Safety
 * `config`: of a cogmint_config that may be written to, or NULL.
 */
cogmint_error cogmint_config_robot(struct cogmint_config *config, uint32_t radio);

/**
 * Standard deviation of the ranges of a cogmint_radio that come on time, metres, for `variance_m2` of cogmint_range; 0 where it
 * has no ranges of its own, or is none.
 */
float cogmint_radio_range_std_m(uint32_t radio);

/**
 * What is wrong, in English: a string that stays. Of a number that is no error code, a text that says so.
 */
const char *cogmint_error_string(uint32_t code);

/**
 * A first-path index as the registers have it, 10.6 bits fixed point, in samples.
 */
float cogmint_first_path_index(uint16_t fixed_point);

/**
 * Writes to `first_sample` at which sample of the accumulator the window around a first path begins, so that no more than
 * `samples_before` + `samples_after` samples from there on need be read.
 *
 * # Safety
 * `first_sample`: of a number that may be written to, or NULL.
 */
cogmint_error cogmint_cir_first_sample(float first_path_index,
                                       uint32_t samples_before,
                                       uint32_t *first_sample);

/**
 * Makes a frame of the bytes of an accumulator. Its samples are written to `samples`, which has room for so many complex ones and has to
 * stay until the tracker has received the frame. `samples_per_frame` of the configuration has to be their number.
 *
 * # Safety
 * `cir` and what it points at may be read; `samples` may be written to, `sample_room` of them; and `frame`. Or they are NULL.
 */
cogmint_error cogmint_cir_frame(const struct cogmint_cir *cir,
                                float (*samples)[2],
                                size_t sample_room,
                                struct cogmint_frame *frame);

/**
 * Writes the distance of a poll and its response to `range_m`, metres.
 *
 * # Safety
 * `stamps` may be read and `range_m` written to, or they are NULL.
 */
cogmint_error cogmint_range_single_sided(const struct cogmint_two_way *stamps, float *range_m);

/**
 * Writes the distance of a poll, its response and the response to that to `range_m`, metres.
 *
 * # Safety
 * `stamps` may be read and `range_m` written to, or they are NULL.
 */
cogmint_error cogmint_range_double_sided(const struct cogmint_two_way *stamps, float *range_m);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

/* Memory of a tracker: its address is what cogmint_start takes, and its size the length. */
typedef union cogmint_memory {
  uint64_t align;
  unsigned char bytes[COGMINT_TRACKER_SIZE];
} cogmint_memory;

#if defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L
_Static_assert(sizeof(cogmint_config) == COGMINT_CONFIG_SIZE, "the layout of cogmint_config");
_Static_assert(sizeof(cogmint_report) == COGMINT_REPORT_SIZE, "the layout of cogmint_report");
_Static_assert(sizeof(cogmint_memory) >= COGMINT_TRACKER_SIZE, "the memory of a tracker");
_Static_assert(_Alignof(cogmint_memory) >= COGMINT_TRACKER_ALIGN, "the alignment of a tracker");
#endif

#endif /* COGMINT_H */
