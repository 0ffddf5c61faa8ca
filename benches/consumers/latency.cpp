// Prints what each report took from when its frame was sent, ns: latency SENSOR N_REPORTS
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <natural_kinds.hpp>

int main(int argc, char** argv) {
    if (argc != 3) return 2;
    natural_kinds::Kinds kinds{argv[1]};
    long n_left = std::atol(argv[2]);
    for (const natural_kinds::Report report : kinds) {
        const auto now = std::chrono::steady_clock::now().time_since_epoch(); // CLOCK_MONOTONIC
        const long long now_ns = std::chrono::nanoseconds{now}.count();
        std::printf("%lld\n", now_ns - static_cast<long long>(report->sent_monotonic_ns));
        if (--n_left == 0) break;
    }
}
