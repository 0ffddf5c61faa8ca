// Says how fast a robot may drive: slowly in one kind of place, slowly where it has never been, not at all without reports.
//
//     slow_down SENSOR KIND SLOW_M_S FAST_M_S
//
// Prints a line whenever the limit changes; a robot's own program would tell its speed controller instead.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <natural_kinds.hpp>

using namespace std::chrono_literals;

namespace {

/// How long the robot may drive without a report: a few frames of its sensor.
constexpr auto patience = 1s;
/// From here on a frame is unlike what the model has seen.
constexpr double novel = 0.99;
/// Slow from the first of these probabilities on, until the second: at one threshold the robot would go to and fro.
constexpr double begins = 0.6, ends = 0.4;

/// A reason to drive at some speed.
enum class Place { usual, slow_kind, unknown, no_reading, no_report };

const char* words(Place place) {
    switch (place) {
    case Place::usual: return "as usual";
    case Place::slow_kind: return "in the slow kind";
    case Place::unknown: return "unlike any place seen";
    case Place::no_reading: return "the sensor sees nothing";
    case Place::no_report: return "no reports";
    }
    return "";
}

Place place_of(const natural_kinds::Report& report, std::size_t slow_kind, Place last) {
    if (!report.is_classified()) return Place::no_reading;
    if (report->novelty >= novel) return Place::unknown;
    // Given all frames so far: these flicker less than those of the frame by itself.
    const auto filtered = report.filtered();
    const double probability = slow_kind < filtered.size() ? filtered[slow_kind] : 0.0;
    return probability > (last == Place::slow_kind ? ends : begins) ? Place::slow_kind : Place::usual;
}

double limit_m_s(Place place, double slow_m_s, double fast_m_s) {
    switch (place) {
    case Place::usual: return fast_m_s;
    case Place::slow_kind: case Place::unknown: return slow_m_s;
    case Place::no_reading: case Place::no_report: return 0.0;
    }
    return 0.0;
}

} // namespace

int main(int argc, char** argv) try {
    if (argc != 5) {
        std::fprintf(stderr, "slow_down SENSOR KIND SLOW_M_S FAST_M_S\n");
        return 2;
    }
    const std::size_t slow_kind = std::strtoul(argv[2], nullptr, 10);
    const double slow_m_s = std::atof(argv[3]), fast_m_s = std::atof(argv[4]);
    natural_kinds::Kinds kinds{argv[1]};
    Place last = Place::no_report; // whoever starts stands still
    for (;;) {
        const auto report = kinds.next(patience);
        const Place place = report ? place_of(*report, slow_kind, last) : Place::no_report;
        if (place != last) {
            std::printf("%.2f m/s: %s\n", limit_m_s(place, slow_m_s, fast_m_s), words(place));
            std::fflush(stdout);
        }
        last = place;
    }
} catch (const natural_kinds::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
