// Prints each frame's kinds where those most alike are taken together until two are left: levels SENSOR N_REPORTS
#include <cstdio>
#include <cstdlib>
#include <natural_kinds.hpp>

int main(int argc, char** argv) try {
    if (argc != 3) return 2;
    natural_kinds::Kinds kinds{argv[1]};
    long n_left = std::atol(argv[2]);
    for (const natural_kinds::Report report : kinds) {
        const natural_kinds::Level level = report.at_level(2);
        std::printf("frame %llu:", static_cast<unsigned long long>(report->sequence));
        for (double probability : level.probabilities()) std::printf(" %.6f", probability);
        for (double probability : level.filtered()) std::printf(" %.6f", probability);
        for (unsigned group : level.groups()) std::printf(" %u", group);
        for (unsigned number : report.numbers()) std::printf(" %u", number);
        std::puts("");
        std::fflush(stdout);
        if (--n_left == 0) break;
    }
} catch (const natural_kinds::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
