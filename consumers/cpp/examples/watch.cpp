// Prints the kind of each frame: watch SENSOR N_REPORTS
#include <cstdio>
#include <cstdlib>
#include <natural_kinds.hpp>

int main(int argc, char** argv) try {
    if (argc != 3) return 2;
    natural_kinds::Kinds kinds{argv[1]};
    long n_left = std::atol(argv[2]);
    for (const natural_kinds::Report report : kinds) { // in shared memory, until the next one
        std::printf("frame %llu: kind %u, probability %.6f\n", static_cast<unsigned long long>(report->sequence),
                    report->kind, report.probabilities()[report->kind]);
        std::fflush(stdout);
        if (--n_left == 0) break;
    }
} catch (const natural_kinds::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
