// Prints how messages lie in memory for this compiler, as consumers/layout.csv has it.
#include <natural_kinds.h>
#include <stdio.h>

#define FIELD(message, field) \
    printf("%s,%s,%zu,%zu\n", #message, #field, offsetof(message, field), sizeof(((message *)0)->field));
#define END(message) printf("%s,,0,%zu\n", #message, sizeof(message));

int main(void) {
    puts("type,field,offset,bytes");
    FIELD(kinds_pose, x_m)
    FIELD(kinds_pose, y_m)
    FIELD(kinds_pose, yaw_rad)
    END(kinds_pose)
    FIELD(kinds_command, forward_m_s)
    FIELD(kinds_command, turn_rad_s)
    END(kinds_command)
    FIELD(kinds_frame_header, version)
    FIELD(kinds_frame_header, flags)
    FIELD(kinds_frame_header, run)
    FIELD(kinds_frame_header, sequence)
    FIELD(kinds_frame_header, captured_ns)
    FIELD(kinds_frame_header, sent_monotonic_ns)
    FIELD(kinds_frame_header, metres_per_count)
    FIELD(kinds_frame_header, rows)
    FIELD(kinds_frame_header, columns)
    FIELD(kinds_frame_header, pose)
    FIELD(kinds_frame_header, command)
    FIELD(kinds_frame_header, true_pose)
    END(kinds_frame_header)
    FIELD(kinds_report, version)
    FIELD(kinds_report, status)
    FIELD(kinds_report, kind)
    FIELD(kinds_report, filtered_kind)
    FIELD(kinds_report, n_kinds)
    FIELD(kinds_report, n_dims)
    FIELD(kinds_report, n_invalid)
    FIELD(kinds_report, n_filtered)
    FIELD(kinds_report, run)
    FIELD(kinds_report, sequence)
    FIELD(kinds_report, n_lost)
    FIELD(kinds_report, captured_ns)
    FIELD(kinds_report, sent_monotonic_ns)
    FIELD(kinds_report, received_monotonic_ns)
    FIELD(kinds_report, reported_monotonic_ns)
    FIELD(kinds_report, model_id)
    FIELD(kinds_report, log_likelihood)
    FIELD(kinds_report, novelty)
    FIELD(kinds_report, probabilities)
    FIELD(kinds_report, filtered)
    FIELD(kinds_report, coordinates)
    FIELD(kinds_report, numbers)
    FIELD(kinds_report, merges)
    END(kinds_report)
}
