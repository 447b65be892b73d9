/* Replays a feed, which `cogmint trace --feed FILE` writes, and prints the hash over all state after every cycle: it has to be that of the
 * trace. firmware-stub/src/feed.rs documents the layout of a feed.
 *
 * Then the map alone goes into a tracker that is started anew: what it makes of that has to be what Rust makes of it
 * (tests/examples/map_carried.rs). */

#include <stdint.h>
#include <string.h>

#include "cogmint.h"
#include "feed_io.h"

/* Little-endian "COG5". */
#define MAGIC 0x35474f43u
/* Room for a map: some 20 bytes per source, 60 per surface, 16 per pair of surfaces. */
#define MOST_MAP_BYTES 2048
/* Room for one frame, complex samples. */
#define MOST_SAMPLES 1024

static cogmint_memory memory;
static float samples[2 * MOST_SAMPLES];
static cogmint_range ranges[COGMINT_MOST_ANCHORS][COGMINT_MOST_PATHS];

/* What the tracker is told; needed until it is started. */
static cogmint_config config;
static cogmint_anchor anchors[COGMINT_MOST_ANCHORS];
static float range_biases_m[COGMINT_MOST_ANCHORS][2];
static cogmint_virtual_anchor virtual_anchors[COGMINT_MOST_SOURCES];
static cogmint_action actions[COGMINT_MOST_ACTIONS];
static float outline_m[COGMINT_MOST_SEGMENTS][2];
static cogmint_wall walls[COGMINT_MOST_SEGMENTS];
static cogmint_segment segments[COGMINT_MOST_SEGMENTS];
static cogmint_plan plan;
static cogmint_map map;
static uint32_t anchor_count;
static uint32_t action_count;
static uint64_t seed;

static uint8_t map_bytes[MOST_MAP_BYTES];

static void put_text(const char *text) { text_write(text, strlen(text)); }

static void put_decimal(uint32_t number) {
  char digits[10];
  size_t begin = sizeof digits;
  do {
    digits[--begin] = (char)('0' + number % 10);
    number /= 10;
  } while (number != 0);
  text_write(digits + begin, sizeof digits - begin);
}

static void put_hexadecimal(uint64_t number) {
  char digits[16];
  for (size_t i = 0; i < sizeof digits; ++i) {
    digits[i] = "0123456789abcdef"[number >> (60 - 4 * i) & 0xf];
  }
  text_write(digits, sizeof digits);
}

/* Says what is wrong. */
static int fail(const char *what) {
  put_text("error ");
  put_text(what);
  put_text("\n");
  return 1;
}

/* Whether the feed ended too early: looked at once after many words, which are 0 then. */
static bool is_short;

static uint32_t word(void) {
  uint8_t bytes[4] = {0};
  if (!feed_read(bytes, sizeof bytes)) {
    is_short = true;
    return 0;
  }
  return bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static float number(void) {
  const uint32_t bits = word();
  float value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static void pair(float values[2]) {
  values[0] = number();
  values[1] = number();
}

/* Settings that a feed has, over the published ones. */
static void read_config(void) {
  config.acceleration_density_m2_s3 = number();
  config.velocity_decay_s = number();
  pair(config.start_position_m);
  config.start_position_std_m = number();
  config.start_velocity_std_m_s = number();
  config.detection_probability = number();
  config.clutter_per_anchor = number();
  config.max_range_m = number();
  config.bias_mean_m = number();
  config.bias_std_m = number();
  config.path_floor_pulses = number();
  config.late_m = number();
  config.sample_spacing_s = number();
  config.pulse_samples = word();
  if (config.pulse_samples == 0) {
    config.pulse_roll_off = number();
  } else {
    config.pulse_step_s = number();
    for (uint32_t i = 0; i < config.pulse_samples && !is_short; ++i) {
      const float sample = number();
      if (i < COGMINT_PULSE_SAMPLES) {
        config.pulse_autocorrelation[i] = sample;
      }
    }
  }
  config.samples_per_frame = word();
  const uint32_t radio = word();
  config.has_gain_control = radio & 1;
  config.dense_begins_with_path = radio & 2;
  config.has_heading = word();
  config.anchor_work = word();
  config.comparisons = word();
  config.first_action = word();
  config.planned_actions = word();
}

/* False where it is larger than there is room for. */
static bool read_plan(void) {
  plan.corner_count = word();
  plan.wall_count = word();
  plan.segment_count = word();
  plan.turn_std_rad = number();
  plan.reflections = word();
  plan.most_sources = word();
  if (plan.corner_count > COGMINT_MOST_SEGMENTS || plan.wall_count > COGMINT_MOST_SEGMENTS ||
      plan.segment_count > COGMINT_MOST_SEGMENTS) {
    return false;
  }
  for (size_t i = 0; i < plan.corner_count; ++i) {
    pair(outline_m[i]);
  }
  for (size_t i = 0; i < plan.wall_count; ++i) {
    walls[i].offset_std_m = number();
    walls[i].rotation_std_rad = number();
  }
  for (size_t i = 0; i < plan.segment_count; ++i) {
    segments[i].wall = word();
    pair(segments[i].ends_m[0]);
    pair(segments[i].ends_m[1]);
  }
  plan.outline_m = (const float(*)[2])outline_m;
  plan.walls = walls;
  plan.segments = segments;
  return true;
}

/* Reads the set-up; the number of cycles that follow. */
static int read_setup(uint32_t *cycles) {
  if (word() != MAGIC) {
    return fail("no feed");
  }
  anchor_count = word();
  map.virtual_anchor_count = word();
  action_count = word();
  *cycles = word();
  seed = word();
  seed |= (uint64_t)word() << 32;
  if (anchor_count > COGMINT_MOST_ANCHORS || map.virtual_anchor_count > COGMINT_MOST_SOURCES ||
      action_count > COGMINT_MOST_ACTIONS) {
    return fail("too large a set-up");
  }
  cogmint_config_published(&config);
  read_config();
  for (uint32_t i = 0; i < anchor_count; ++i) {
    pair(anchors[i].position_m);
    anchors[i].height_m = number();
    pair(range_biases_m[i]);
  }
  for (uint32_t i = 0; i < map.virtual_anchor_count; ++i) {
    virtual_anchors[i].anchor = word();
    pair(virtual_anchors[i].position_m);
    virtual_anchors[i].std_m = number();
  }
  map.virtual_anchors = virtual_anchors;
  if (word() != 0) {
    if (!read_plan()) {
      return fail("too large a plan");
    }
    map.plan = &plan;
  }
  for (uint32_t i = 0; i < action_count; ++i) {
    actions[i].carrier_hz = number();
    actions[i].pulse_duration_s = number();
  }
  return is_short ? fail("malformed feed") : 0;
}

/* Starts the tracker as it was told, afresh where it ran. */
static cogmint_error start(cogmint_tracker **tracker) {
  cogmint_error error = cogmint_start(&memory, sizeof memory, &config, anchors, anchor_count, &map, actions,
                                      action_count, seed, tracker);
  for (uint32_t i = 0; i < anchor_count && error == COGMINT_ERROR_NONE; ++i) {
    error = cogmint_tell_range_bias(*tracker, i, range_biases_m[i][0], range_biases_m[i][1]);
  }
  return error;
}

/* Reads a frame and gives it to the tracker. */
static cogmint_error receive_frame(cogmint_tracker *tracker) {
  cogmint_frame frame = {0};
  frame.anchor = word();
  frame.action = word();
  frame.first_sample_delay_s = number();
  frame.kind = word() != 0 ? COGMINT_SAMPLES_MAGNITUDE : COGMINT_SAMPLES_COMPLEX;
  frame.sample_count = word();
  frame.samples = samples;
  if (frame.sample_count > MOST_SAMPLES) {
    return COGMINT_ERROR_FRAME_LENGTH;
  }
  const size_t numbers = frame.kind == COGMINT_SAMPLES_COMPLEX ? 2 * frame.sample_count : frame.sample_count;
  /* Both machines are little-endian, as the feed is. */
  is_short |= !feed_read(samples, numbers * sizeof *samples);
  return cogmint_receive_frame(tracker, &frame);
}

/* Reads all ranges of a cycle, sorted by anchor, and gives them to the tracker. */
static cogmint_error receive_ranges(cogmint_tracker *tracker) {
  size_t counts[COGMINT_MOST_ANCHORS] = {0};
  for (uint32_t left = word(); left > 0 && !is_short; --left) {
    const uint32_t anchor = word();
    if (anchor >= COGMINT_MOST_ANCHORS || counts[anchor] >= COGMINT_MOST_PATHS) {
      return COGMINT_ERROR_RANGE_COUNT;
    }
    cogmint_range *const range = &ranges[anchor][counts[anchor]++];
    range->range_m = number();
    range->variance_m2 = number();
  }
  for (uint32_t anchor = 0; anchor < COGMINT_MOST_ANCHORS; ++anchor) {
    if (counts[anchor] > 0) {
      const cogmint_error error = cogmint_receive_ranges(tracker, anchor, ranges[anchor], counts[anchor]);
      if (error != COGMINT_ERROR_NONE) {
        return error;
      }
    }
  }
  return COGMINT_ERROR_NONE;
}

/* One cycle, and the hash after it. */
static cogmint_error run_cycle(cogmint_tracker *tracker, uint64_t *hash) {
  const float elapsed_s = number();
  const bool is_height_known = word() != 0;
  cogmint_tag_height height;
  height.mean_m = number();
  height.std_m = number();
  float lever_arm_m[2];
  pair(lever_arm_m);
  cogmint_error error = cogmint_switch_antenna(tracker, lever_arm_m[0], lever_arm_m[1]);
  if (error == COGMINT_ERROR_NONE) {
    error = cogmint_begin(tracker, elapsed_s, is_height_known ? &height : NULL);
  }
  for (uint32_t frames = error == COGMINT_ERROR_NONE ? word() : 0; frames > 0; --frames) {
    error = receive_frame(tracker);
    if (error != COGMINT_ERROR_NONE) {
      return error;
    }
  }
  if (error == COGMINT_ERROR_NONE) {
    error = receive_ranges(tracker);
  }
  cogmint_report report;
  if (error == COGMINT_ERROR_NONE) {
    error = cogmint_finish(tracker, &report);
  }
  return error == COGMINT_ERROR_NONE ? cogmint_hash(tracker, hash) : error;
}

static uint32_t bits(float value) {
  uint32_t word;
  memcpy(&word, &value, sizeof word);
  return word;
}

/* The map alone, into a tracker that is started anew in the same memory; then one cycle, in which every anchor is 3 m away. */
static cogmint_error carry_map(cogmint_tracker *tracker) {
  size_t length = 0;
  cogmint_error error = cogmint_map_snapshot(tracker, NULL, &length);
  if (error != COGMINT_ERROR_SNAPSHOT_ROOM) {
    return error;
  }
  const size_t needed = length;
  length = sizeof map_bytes;
  error = cogmint_map_snapshot(tracker, map_bytes, &length);
  cogmint_map_restored restored = {0};
  if (error == COGMINT_ERROR_NONE) {
    /* It has run: a map comes too late. */
    const cogmint_error late = cogmint_map_restore(tracker, map_bytes, length, &restored);
    error = late == COGMINT_ERROR_ALREADY_BEGUN && length == needed ? start(&tracker) : late;
  }
  if (error == COGMINT_ERROR_NONE) {
    /* A byte that was flipped is seen. */
    map_bytes[length / 2] ^= 1;
    const cogmint_error damaged = cogmint_map_restore(tracker, map_bytes, length, NULL);
    map_bytes[length / 2] ^= 1;
    error = damaged == COGMINT_ERROR_SNAPSHOT_DAMAGED ? COGMINT_ERROR_NONE : damaged;
  }
  if (error == COGMINT_ERROR_NONE) {
    error = cogmint_map_restore(tracker, map_bytes, length, &restored);
  }
  if (error == COGMINT_ERROR_NONE) {
    error = cogmint_begin(tracker, 0.1f, NULL);
  }
  const cogmint_range range = {3.0f, 0.01f};
  for (uint32_t i = 0; i < anchor_count && error == COGMINT_ERROR_NONE; ++i) {
    error = cogmint_receive_ranges(tracker, i, &range, 1);
  }
  cogmint_report report;
  uint64_t hash = 0;
  if (error == COGMINT_ERROR_NONE) {
    error = cogmint_finish(tracker, &report);
  }
  if (error == COGMINT_ERROR_NONE) {
    error = cogmint_hash(tracker, &hash);
  }
  if (error != COGMINT_ERROR_NONE) {
    return error;
  }
  const uint32_t figures[] = {(uint32_t)length,
                              restored.surfaces,
                              restored.surfaces_left_out,
                              restored.sources,
                              restored.sources_left_out,
                              report.associated,
                              bits(report.position_m[0]),
                              bits(report.position_m[1]),
                              bits(report.entropy_nat)};
  put_text("map");
  for (size_t i = 0; i < sizeof figures / sizeof *figures; ++i) {
    put_text(" ");
    put_decimal(figures[i]);
  }
  put_text(" hash ");
  put_hexadecimal(hash);
  put_text("\n");
  return COGMINT_ERROR_NONE;
}

int replay(void) {
  cogmint_tracker *tracker = NULL;
  uint32_t cycles = 0;
  if (read_setup(&cycles) != 0) {
    return 1;
  }
  cogmint_error error = start(&tracker);
  if (error != COGMINT_ERROR_NONE) {
    return fail(cogmint_error_string(error));
  }
  for (uint32_t cycle = 0; cycle < cycles; ++cycle) {
    uint64_t hash = 0;
    error = run_cycle(tracker, &hash);
    if (is_short) {
      return fail("malformed cycle");
    }
    if (error != COGMINT_ERROR_NONE) {
      return fail(cogmint_error_string(error));
    }
    put_text("cycle ");
    put_decimal(cycle);
    put_text(" hash ");
    put_hexadecimal(hash);
    put_text("\n");
  }
  put_text("stack ");
  put_decimal((uint32_t)stack_used());
  put_text(" tracker ");
  put_decimal((uint32_t)cogmint_tracker_size());
  put_text("\n");
  error = carry_map(tracker);
  return error == COGMINT_ERROR_NONE ? 0 : fail(cogmint_error_string(error));
}
