/* A tag on a circle, tracked by its ranges to the anchors: as many as the library has room for, four or two.
 *
 * Prints every tenth position; exit code 0 only where the error is small, and a snapshot goes on with the same bits. */

#include <math.h>
#include <stdbool.h>
#include <stdio.h>

#include "cogmint.h"

#define CYCLES 600
#define ELAPSED_S 0.1
#define RADIUS_M 2.5
#define SPEED_M_S 1.2
/* Cycles until the start is forgotten. */
#define SETTLED 50
/* Of the root mean squared error, metres. */
#define LARGEST_RMSE_M 0.25

static cogmint_memory memory;
static cogmint_memory other_memory;
static uint8_t snapshot[COGMINT_TRACKER_SIZE];

/* Says what is wrong. */
static void say(cogmint_error error, const char *call) {
  fprintf(stderr, "%s: %s\n", call, cogmint_error_string(error));
}

#define TRY(call)                     \
  do {                                \
    const cogmint_error error = call; \
    if (error != COGMINT_ERROR_NONE) { \
      say(error, #call);              \
      return 1;                       \
    }                                 \
  } while (false)

/* Uniform between 0 and 1, of a linear congruence. */
static double uniform(void) {
  static uint64_t state = 1;
  state = state * 6364136223846793005u + 1442695040888963407u;
  return ((double)(state >> 11) + 0.5) / 9007199254740992.0;
}

/* Normal deviates (Box and Muller 1958). */
static double normal(void) {
  const double radius = sqrt(-2.0 * log(uniform()));
  return radius * cos(6.283185307179586 * uniform());
}

/* What a caller may get wrong is refused and not obeyed. */
static int refusals(cogmint_tracker *tracker, const cogmint_config *config, const cogmint_anchor *anchors) {
  cogmint_tracker *none = NULL;
  cogmint_report report;
  cogmint_config wrong = *config;
  wrong.start_position_std_m = NAN;
  const cogmint_error got[] = {
      cogmint_start(NULL, sizeof memory, config, anchors, 1, NULL, NULL, 0, 1, &none),
      cogmint_start(other_memory.bytes + 1, sizeof memory - 1, config, anchors, 1, NULL, NULL, 0, 1, &none),
      cogmint_start(&other_memory, cogmint_tracker_size() - 1, config, anchors, 1, NULL, NULL, 0, 1, &none),
      cogmint_start(&other_memory, sizeof memory, config, NULL, 1, NULL, NULL, 0, 1, &none),
      cogmint_start(&other_memory, sizeof memory, config, anchors, COGMINT_MOST_ANCHORS + 1, NULL, NULL, 0, 1, &none),
      cogmint_start(&other_memory, sizeof memory, &wrong, anchors, 1, NULL, NULL, 0, 1, &none),
      cogmint_begin(NULL, 0.1f, NULL),
      cogmint_begin(tracker, -0.1f, NULL),
      cogmint_finish(tracker, &report),
      cogmint_restore(tracker, snapshot, 7),
      cogmint_config_robot(&wrong, 77),
  };
  const cogmint_error expected[] = {
      COGMINT_ERROR_NULL_POINTER, COGMINT_ERROR_MEMORY_SIZE,  COGMINT_ERROR_MEMORY_SIZE,
      COGMINT_ERROR_NULL_POINTER, COGMINT_ERROR_ANCHOR_COUNT, COGMINT_ERROR_SETTING_START_DEVIATION,
      COGMINT_ERROR_NULL_POINTER, COGMINT_ERROR_TIME,         COGMINT_ERROR_NOT_BEGUN,
      COGMINT_ERROR_SNAPSHOT_FOREIGN, COGMINT_ERROR_UNKNOWN_CHOICE,
  };
  for (size_t i = 0; i < sizeof got / sizeof *got; ++i) {
    /* Of memory that is neither aligned nor long enough, either may be said. */
    const bool either = i == 1 && got[i] == COGMINT_ERROR_ALIGNMENT;
    if (got[i] != expected[i] && !either) {
      fprintf(stderr, "refusal %zu: %s\n", i, cogmint_error_string(got[i]));
      return 1;
    }
  }
  return none != NULL;
}

int main(void) {
  static const cogmint_anchor places[] = {
      {{0.3f, 0.2f}, 0.0f}, {{9.7f, 0.4f}, 0.0f}, {{9.6f, 7.7f}, 0.0f}, {{0.2f, 7.8f}, 0.0f}};
  /* Channel 5. */
  static const cogmint_action action = {6.4896e9f, 2.0e-9f};
  const size_t anchors = COGMINT_MOST_ANCHORS;
  const float std_m = cogmint_radio_range_std_m(COGMINT_RADIO_DW1000);

  cogmint_config config;
  TRY(cogmint_config_pedestrian(&config, COGMINT_RADIO_DW1000));
  config.start_position_m[0] = 7.0f;
  config.start_position_m[1] = 4.0f;
  if (anchors == 2) {
    /* Two anchors have the mirror image of every place as well, and no range tells of a bias: say what is known. */
    config.start_position_std_m = 0.7f;
    config.bias_std_m = 0.0f;
  }

  cogmint_tracker *tracker = NULL;
  cogmint_tracker *other = NULL;
  TRY(cogmint_start(&memory, sizeof memory, &config, places, anchors, NULL, &action, 1, 1, &tracker));
  TRY(cogmint_start(&other_memory, sizeof other_memory, &config, places, anchors, NULL, &action, 1, 1, &other));

  double square_m2 = 0.0;
  for (int cycle = 0; cycle < CYCLES; ++cycle) {
    const double angle = cycle * ELAPSED_S * SPEED_M_S / RADIUS_M;
    const double x_m = 5.0 + RADIUS_M * cos(angle);
    const double y_m = 4.0 + RADIUS_M * sin(angle);
    cogmint_range ranges[COGMINT_MOST_ANCHORS];
    for (size_t i = 0; i < anchors; ++i) {
      const double direct_m = hypot(x_m - places[i].position_m[0], y_m - places[i].position_m[1]);
      ranges[i].range_m = (float)(direct_m + std_m * normal());
      ranges[i].variance_m2 = std_m * std_m;
    }

    cogmint_report report;
    TRY(cogmint_begin(tracker, (float)ELAPSED_S, NULL));
    for (size_t i = 0; i < anchors; ++i) {
      TRY(cogmint_receive_ranges(tracker, (uint32_t)i, &ranges[i], 1));
    }
    TRY(cogmint_finish(tracker, &report));

    /* The other one goes on from a snapshot half way. */
    if (cycle == CYCLES / 2) {
      size_t length = 0;
      if (cogmint_snapshot(tracker, NULL, &length) != COGMINT_ERROR_SNAPSHOT_ROOM || length > sizeof snapshot) {
        fprintf(stderr, "a snapshot of %zu bytes\n", length);
        return 1;
      }
      TRY(cogmint_snapshot(tracker, snapshot, &length));
      TRY(cogmint_restore(other, snapshot, length));
      printf("snapshot of %zu bytes\n", length);
    } else if (cycle > CYCLES / 2) {
      cogmint_report again;
      TRY(cogmint_begin(other, (float)ELAPSED_S, NULL));
      for (size_t i = 0; i < anchors; ++i) {
        TRY(cogmint_receive_ranges(other, (uint32_t)i, &ranges[i], 1));
      }
      TRY(cogmint_finish(other, &again));
    }

    const double error_m = hypot(report.position_m[0] - x_m, report.position_m[1] - y_m);
    if (cycle >= SETTLED) {
      square_m2 += error_m * error_m;
    }
    if (cycle % 10 == 0) {
      printf("%5.1f s  at %5.2f %5.2f m, %4.2f m off, +- %4.2f %4.2f m, %5.2f %5.2f m/s%s\n", cycle * ELAPSED_S,
             report.position_m[0], report.position_m[1], error_m, sqrt(report.position_covariance_m2[0]),
             sqrt(report.position_covariance_m2[2]), report.velocity_m_s[0], report.velocity_m_s[1],
             report.searching ? ", searching" : "");
    }
  }

  uint64_t hash = 0;
  uint64_t other_hash = 1;
  TRY(cogmint_hash(tracker, &hash));
  TRY(cogmint_hash(other, &other_hash));
  const double rmse_m = sqrt(square_m2 / (CYCLES - SETTLED));
  printf("%zu anchors: %.3f m off (RMSE), %zu bytes of memory, hash %016llx\n", anchors, rmse_m, cogmint_tracker_size(),
         (unsigned long long)hash);
  if (hash != other_hash) {
    fprintf(stderr, "what goes on from a snapshot has other bits\n");
    return 1;
  }
  if (!(rmse_m < LARGEST_RMSE_M)) {
    fprintf(stderr, "more than %.2f m off\n", LARGEST_RMSE_M);
    return 1;
  }
  return refusals(tracker, &config, places);
}
