/* Kinds of places, and the frames that they are told from, through shared memory: libnatural_kinds, for C and C++.
 *
 * A program that is linked with the shared library starts with any of the same ABI, by the name of libnatural_kinds.so.0.1.
 *
 * Made of the library's sources; do not edit. Every function that could not do what it was asked for returns KINDS_ERROR or NULL,
 * and kinds_last_error() says why, in words.
 *
 * Threads: a handle, and all that came from it, is for one thread at a time, and a thread may hand them to another. Two threads
 * that use one handle at once get an error. Several handles in one program do not know each other. After fork() a child must not
 * touch its parent's. Signals are left to the program: a wait that one interrupts says so.
 */

#ifndef NATURAL_KINDS_H
#define NATURAL_KINDS_H

#include <stddef.h>
#include <stdint.h>

/// Most kinds that a report holds.
#define KINDS_MAX_KINDS 64

/// Most coordinates that a report holds.
#define KINDS_MAX_DIMS 32

/// The call could not do it: see `kinds_last_error`.
#define KINDS_ERROR -1

/// Nothing came until the timeout.
#define KINDS_NOTHING 0

/// There it is.
#define KINDS_RECEIVED 1

/// A signal came while waiting: look at the flag that your handler sets, and go on if it is not. A program that was stopped and
/// continued is told so too.
#define KINDS_INTERRUPTED 2

/// Sleep until there is something.
#define KINDS_BY_EVENT 0

/// Look again and again instead of sleeping: quicker by the wake-up, and takes one processor core while it waits.
#define KINDS_POLLING 1

/// A reader of a sensor's frames.
typedef struct kinds_frames kinds_frames;

/// The publisher of a sensor's frames.
typedef struct kinds_publisher kinds_publisher;

/// A reader of a sensor's kinds.
typedef struct kinds_reports kinds_reports;

/// Kind probabilities of one frame, with all that is needed to tell which frame, by which model and how fast.
typedef struct kinds_report {
  /// `VERSION` of the program that wrote this.
  uint32_t version;
  /// `CLASSIFIED`, or anything else for a frame that told nothing.
  uint32_t status;
  /// The most probable kind of the frame by itself: its index in `probabilities`, counted from 0. What people call it by is its
  /// number.
  uint32_t kind;
  /// The most probable kind given all frames of the run so far, as its index: changes less often than `kind`.
  uint32_t filtered_kind;
  /// How many kinds the model has: the first so many probabilities are set.
  uint32_t n_kinds;
  /// How many dimensions the model has: the first so many coordinates are set.
  uint32_t n_dims;
  /// Readings of the frame without measurement.
  uint32_t n_invalid;
  /// How many frames of the run the filtered probabilities rest on, this one included; 1 after a start or another model.
  uint32_t n_filtered;
  /// The frame's run: start of the driver shim that published it, ns since the epoch.
  uint64_t run;
  /// The frame's number within its run.
  uint64_t sequence;
  /// Frames of this run that the service missed just before this one.
  uint64_t n_lost;
  /// When the sensor captured the frame, ns since the epoch.
  int64_t captured_ns;
  /// When the driver shim sent the frame, ns on CLOCK_MONOTONIC.
  uint64_t sent_monotonic_ns;
  /// When the service received the frame.
  uint64_t received_monotonic_ns;
  /// When the service sent this report. Set by sending.
  uint64_t reported_monotonic_ns;
  /// Identity of the model: the first bytes of its digest.
  uint8_t model_id[16];
  /// ln p(frame) under the mixture; NaN when invalid.
  double log_likelihood;
  /// From 0, like the frames the model was trained on, to 1, unlike any of them.
  double novelty;
  /// Probability of each kind, of the frame by itself.
  double probabilities[KINDS_MAX_KINDS];
  /// Probability of each kind given all frames of the run so far.
  double filtered[KINDS_MAX_KINDS];
  /// Place of the frame in the embedding.
  double coordinates[KINDS_MAX_DIMS];
  /// Number of each kind: its own for ever, where its index may be another one's in the next model.
  uint32_t numbers[KINDS_MAX_KINDS];
  /// Which kinds are most alike: `n_kinds` − 1 pairs of indices, in the order in which they come together. The second of a pair,
  /// and all that have joined it, join the first.
  uint8_t merges[KINDS_MAX_KINDS][2];
} kinds_report;
/// Version of this layout. Readers refuse reports of any other.
#define kinds_report_VERSION 3
/// `status` of a frame that was classified.
#define kinds_report_CLASSIFIED 0
/// `status` of a frame that told nothing.
#define kinds_report_INVALID 1

/// Place of the robot on the floor when a frame was captured, in the frame that the robot calls fixed (ROS: `odom` or
/// `map`).
typedef struct kinds_pose {
  /// Forward of the fixed frame's origin, metres.
  double x_m;
  /// Left of the fixed frame's origin, metres.
  double y_m;
  /// Heading counter-clockwise from the fixed frame's x axis, radians.
  double yaw_rad;
} kinds_pose;

/// What the robot had been told to do when a frame was captured.
typedef struct kinds_command {
  /// Speed forward, metres per second.
  double forward_m_s;
  /// Turn counter-clockwise, radians per second.
  double turn_rad_s;
} kinds_command;

/// Everything about a frame but its counts, which are the message's payload: `rows` × `columns` of `u16`, row by row,
/// 0 for a reading without measurement.
typedef struct kinds_frame_header {
  /// `VERSION` of the program that wrote this.
  uint32_t version;
  /// `HAS_POSE`, `HAS_COMMAND` and `HAS_TRUE_POSE`, or-ed.
  uint32_t flags;
  /// Start of the publishing driver shim, ns since the epoch. Identifies a run, within which `sequence` counts; it
  /// is compared for equality only, since the wall clock may be set between two runs.
  uint64_t run;
  /// Number of this frame within its run, from 0.
  uint64_t sequence;
  /// When the sensor captured the frame, ns since the epoch.
  int64_t captured_ns;
  /// When the frame was sent, ns on CLOCK_MONOTONIC. Set by sending.
  uint64_t sent_monotonic_ns;
  /// Metres that one count stands for.
  double metres_per_count;
  /// Rows of the sensor: 1 for a ring.
  uint32_t rows;
  /// Columns of the sensor.
  uint32_t columns;
  /// Where the robot takes itself to have been. Meaningful with `HAS_POSE`.
  struct kinds_pose pose;
  /// What the robot had been told to do. Meaningful with `HAS_COMMAND`.
  struct kinds_command command;
  /// Where the robot was, told by somebody who need not guess: a simulation, a tracking system. For judging kinds and
  /// poses, never for making them. Meaningful with `HAS_TRUE_POSE`.
  struct kinds_pose true_pose;
} kinds_frame_header;
/// Version of this layout. Readers refuse frames of any other.
#define kinds_frame_header_VERSION 1
/// The robot knew where it was.
#define kinds_frame_header_HAS_POSE 1
/// The robot knew what it had been told to do.
#define kinds_frame_header_HAS_COMMAND 2
/// Somebody knew where the robot truly was.
#define kinds_frame_header_HAS_TRUE_POSE 4

/// A frame in shared memory, where the driver shim wrote it.
typedef struct kinds_frame {
  /// All but the counts.
  const struct kinds_frame_header *header;
  /// The counts, row by row; 0 for a reading without measurement.
  const uint16_t *counts;
  /// How many counts there are: the header's rows × columns.
  size_t n_readings;
} kinds_frame;

/// A frame that is being filled: borrowed until it is sent or given back.
typedef struct kinds_loan {
  /// All but the counts; goes with the frame when it is sent. As lent it is numbered, captured now, and knows neither pose nor
  /// command: set those with their flags, `captured_ns` if the device says better, `sequence` to leave a gap. What the sensor is
  /// was settled by opening, and is set by sending.
  struct kinds_frame_header header;
  /// The counts, row by row, all 0 (no measurement) as lent; in shared memory, where readers will read them.
  uint16_t *counts;
  /// How many counts there are: rows × columns.
  size_t n_readings;
} kinds_loan;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/// Why the last call that failed on this thread did so: a sentence in UTF-8. Empty if none has failed.
///
/// Valid until the next call that fails on this thread.
const char *kinds_last_error(void);

/// The version of this library, such as "0.1.0". Programs on one machine should all have the same.
const char *kinds_version(void);

/// Opens a sensor's kinds, whether or not a service is there: it may come later, go, and come back.
///
/// `sensor`: such as "crunch/ring". `domain`: the folder that the robot's programs meet in; NULL for the environment's
/// `KINDS_DOMAIN`, and without one for the default. `waiting`: `KINDS_BY_EVENT` or `KINDS_POLLING`.
///
/// NULL if it could not. Who comes late gets the last report at once.
///
/// # Safety
/// Texts end with a zero.
struct kinds_reports *kinds_reports_open(const char *sensor,
                                         const char *domain,
                                         uint32_t waiting);

/// Takes the oldest report that waits; where there is none, waits for one until `timeout_ms` is over (0: does not wait).
///
/// `KINDS_RECEIVED`, `KINDS_NOTHING`, `KINDS_INTERRUPTED` or `KINDS_ERROR`. The report lies in shared memory, where the service
/// wrote it: read it there, or copy it. It is valid until the next call of this function, of `kinds_reports_release` or of
/// `kinds_reports_close`. Its kind and lengths are within it, whoever wrote it.
///
/// A reader that is slow finds the last 256; what it missed shows in `sequence`, within one `run`.
///
/// # Safety
/// `reports` is open, and `report` points to where the pointer belongs.
int32_t kinds_reports_next(struct kinds_reports *reports,
                           uint32_t timeout_ms,
                           const struct kinds_report **report);

/// Gives the report back, before the next one is asked for. Does nothing if there is none.
///
/// # Safety
/// `reports` is open.
int32_t kinds_reports_release(struct kinds_reports *reports);

/// The kinds of a report with those most alike taken together, until `n_kinds` are left: at least 1, and at most all.
///
/// Returns how many groups there are, in the order of their first kinds; `KINDS_ERROR` if there is no report. Each place may be
/// NULL, or has room for `KINDS_MAX_KINDS`. `probabilities`: of each group, of the frame by itself, the sum of its kinds'.
/// `filtered`: the same given all frames of the run so far. `groups`: which group each kind is of, by index.
///
/// # Safety
/// `report` is NULL or a report, and places have room.
int32_t kinds_report_at_level(const struct kinds_report *report,
                              uint32_t n_kinds,
                              double *probabilities,
                              double *filtered,
                              uint8_t *groups);

/// Whether a service is there: 1, or 0. One that was killed is found out within seconds.
///
/// # Safety
/// `reports` is open.
int32_t kinds_reports_is_served(struct kinds_reports *reports);

/// Closes it. NULL is nothing to close.
///
/// # Safety
/// `reports` is NULL or open, and is not used again.
void kinds_reports_close(struct kinds_reports *reports);

/// Opens a sensor's frames, whether or not a driver shim is there. As `kinds_reports_open`; but who comes late gets none of the
/// frames before.
///
/// # Safety
/// Texts end with a zero.
struct kinds_frames *kinds_frames_open(const char *sensor,
                                       const char *domain,
                                       uint32_t waiting);

/// Takes the oldest frame that waits; where there is none, waits for one until `timeout_ms` is over (0: does not wait).
///
/// `KINDS_RECEIVED`, `KINDS_NOTHING`, `KINDS_INTERRUPTED` or `KINDS_ERROR`. The frame is valid until it is released with
/// `kinds_frames_release`, which the driver shim does not wait for; two can be held at a time.
///
/// A reader that is slow finds the last 16; what it missed shows in `sequence`, within one `run`.
///
/// # Safety
/// `frames` is open, and `frame` points to where it is to be described.
int32_t kinds_frames_next(struct kinds_frames *frames,
                          uint32_t timeout_ms,
                          struct kinds_frame *frame);

/// Gives a frame back. 0, or `KINDS_ERROR` if this handle does not hold it.
///
/// # Safety
/// `frames` is open, and `frame` is as `kinds_frames_next` filled it, or a copy of that.
int32_t kinds_frames_release(struct kinds_frames *frames, const struct kinds_frame *frame);

/// Closes it, and gives back what it holds. NULL is nothing to close.
///
/// # Safety
/// `frames` is NULL or open, and is not used again.
void kinds_frames_close(struct kinds_frames *frames);

/// Opens a sensor's frames as their publisher: the only one at a time. Takes the place of one that was killed.
///
/// `sensor` and `domain`: as for `kinds_reports_open`. `rows`: 1 for a ring. `metres_per_count`: what a count stands for. NULL if
/// it could not.
///
/// # Safety
/// Texts end with a zero.
struct kinds_publisher *kinds_publisher_open(const char *sensor,
                                             const char *domain,
                                             uint32_t rows,
                                             uint32_t columns,
                                             double metres_per_count);

/// Borrows the memory of the next frame. 0 or `KINDS_ERROR`. One at a time; send it, or give it back.
///
/// # Safety
/// `publisher` is open, and `loan` points to where the loan is to be described.
int32_t kinds_publisher_borrow(struct kinds_publisher *publisher, struct kinds_loan *loan);

/// Sends the frame that was borrowed, and wakes its readers; waits for none of them. 0 or `KINDS_ERROR`. The loan is over either
/// way.
///
/// # Safety
/// `publisher` is open, and `loan` is as `kinds_publisher_borrow` filled it but for what its header says.
int32_t kinds_publisher_send(struct kinds_publisher *publisher,
                             const struct kinds_loan *loan);

/// Gives back what was borrowed, unsent. 0 or `KINDS_ERROR`.
///
/// # Safety
/// As for `kinds_publisher_send`.
int32_t kinds_publisher_give_back(struct kinds_publisher *publisher, const struct kinds_loan *loan);

/// Lets readers that came since the last frame connect, and cleans up after those that were killed. 0 or `KINDS_ERROR`.
///
/// Call it some twenty times a second while no frames are sent, as while the device is away.
///
/// # Safety
/// `publisher` is open.
int32_t kinds_publisher_update(struct kinds_publisher *publisher);

/// How many programs read the frames, or `KINDS_ERROR`. One that was killed counts until it is cleaned up.
///
/// # Safety
/// `publisher` is open.
int32_t kinds_publisher_n_readers(struct kinds_publisher *publisher);

/// Closes it, and gives back what is borrowed. NULL is nothing to close.
///
/// Frames that no reader has looked at yet go with their publisher: linger for 100 ms after the last one.
///
/// # Safety
/// `publisher` is NULL or open, and is not used again.
void kinds_publisher_close(struct kinds_publisher *publisher);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* NATURAL_KINDS_H */
