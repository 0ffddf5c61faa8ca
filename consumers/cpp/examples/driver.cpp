// Publishes the u16 counts that come on standard input: driver SENSOR ROWS COLUMNS METRES_PER_COUNT
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <natural_kinds.hpp>
#include <thread>

int main(int argc, char** argv) try {
    if (argc != 5) return 2;
    const unsigned rows = std::atoi(argv[2]), columns = std::atoi(argv[3]);
    natural_kinds::FramePublisher publisher{argv[1], {rows, columns, std::atof(argv[4])}};
    for (;;) {
        natural_kinds::Loan loan = publisher.borrow(); // its counts are where readers will read them
        const auto counts = loan.counts();
        if (std::fread(counts.data(), sizeof counts[0], counts.size(), stdin) < counts.size()) break;
        loan.set_command({0.2, 0.0}); // where the robot knows it
        std::move(loan).send();
    }
    std::this_thread::sleep_for(std::chrono::milliseconds{100}); // the last frame goes with its publisher
} catch (const natural_kinds::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
