// Publishes the u16 counts that come on standard input: driver SENSOR ROWS COLUMNS METRES_PER_COUNT
#include <natural_kinds.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

int main(int argc, char **argv) {
    if (argc != 5) return 2;
    kinds_publisher *publisher = kinds_publisher_open(argv[1], NULL, atoi(argv[2]), atoi(argv[3]), atof(argv[4]));
    int failed = publisher == NULL;
    while (!failed) {
        kinds_loan loan; // its counts are where readers will read them
        failed = kinds_publisher_borrow(publisher, &loan);
        if (failed || fread(loan.counts, sizeof *loan.counts, loan.n_readings, stdin) < loan.n_readings) break;
        loan.header.command = (kinds_command){.forward_m_s = 0.2, .turn_rad_s = 0.0}; // where the robot knows it
        loan.header.flags |= kinds_frame_header_HAS_COMMAND;
        failed = kinds_publisher_send(publisher, &loan);
    }
    if (failed) fprintf(stderr, "%s\n", kinds_last_error());
    nanosleep(&(struct timespec){.tv_nsec = 100000000}, NULL); // the last frame goes with its publisher
    kinds_publisher_close(publisher);
    return failed;
}
