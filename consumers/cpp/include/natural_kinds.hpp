// Kinds of places, and the frames that they are told from, through shared memory: C++17 over natural_kinds.h.
//
// Objects close what they hold when they go, and move but do not copy. What could not be done is an Error with the reason in
// words. Threads: as natural_kinds.h says of handles; what a Frame or Loan holds is given back through the object that it came
// from, so it goes first, on the same thread.
#ifndef NATURAL_KINDS_HPP
#define NATURAL_KINDS_HPP

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "natural_kinds.h"

namespace natural_kinds {

/// What could not be done, and why, in words.
class Error : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// How a reader waits.
enum class Waiting : std::uint32_t {
    by_event = KINDS_BY_EVENT, ///< asleep
    polling = KINDS_POLLING,   ///< awake: takes one processor core, and is not woken late
};

/// Numbers that lie elsewhere, one after the other.
template <typename Number>
class Numbers {
public:
    Numbers(Number* first, std::size_t n) : first_{first}, n_{n} {}
    Number* data() const { return first_; }
    std::size_t size() const { return n_; }
    Number* begin() const { return first_; }
    Number* end() const { return first_ + n_; }
    Number& operator[](std::size_t index) const { return first_[index]; }

private:
    Number* first_;
    std::size_t n_;
};

namespace detail {

[[noreturn]] inline void fail() { throw Error{kinds_last_error()}; }

inline int checked(int came) {
    if (came == KINDS_ERROR) fail();
    return came;
}

template <typename Handle>
Handle* checked(Handle* handle) {
    if (handle == nullptr) fail();
    return handle;
}

inline const char* folder(const std::string& domain) { return domain.empty() ? nullptr : domain.c_str(); }

inline std::uint32_t ms(std::chrono::milliseconds timeout) {
    return static_cast<std::uint32_t>(std::clamp<std::int64_t>(timeout.count(), 0, UINT32_MAX));
}

struct Close {
    void operator()(kinds_reports* reports) const { kinds_reports_close(reports); }
    void operator()(kinds_frames* frames) const { kinds_frames_close(frames); }
    void operator()(kinds_publisher* publisher) const { kinds_publisher_close(publisher); }
};

template <typename Handle>
using Owned = std::unique_ptr<Handle, Close>;

} // namespace detail

/// The kinds of a report with those most alike taken together: groups, numbered from 0 in the order of their first kinds.
class Level {
public:
    Level(const kinds_report* report, std::uint32_t n_kinds)
        : n_kinds_{report->n_kinds}, n_groups_{static_cast<std::size_t>(detail::checked(kinds_report_at_level(
              report, n_kinds, probabilities_.data(), filtered_.data(), groups_.data())))} {}

    /// Probability of each group, of the frame by itself.
    Numbers<const double> probabilities() const { return {probabilities_.data(), n_groups_}; }
    /// Probability of each group given all frames of the run so far.
    Numbers<const double> filtered() const { return {filtered_.data(), n_groups_}; }
    /// Which group each kind is of, by index.
    Numbers<const std::uint8_t> groups() const { return {groups_.data(), n_kinds_}; }

private:
    // Filled before they are counted: members are made in the order in which they stand here.
    std::array<double, KINDS_MAX_KINDS> probabilities_{};
    std::array<double, KINDS_MAX_KINDS> filtered_{};
    std::array<std::uint8_t, KINDS_MAX_KINDS> groups_{};
    std::size_t n_kinds_;
    std::size_t n_groups_;
};

/// A report where the service wrote it: `report->sequence` and all other fields of kinds_report. Copy what is to be kept.
class Report {
public:
    explicit Report(const kinds_report* report) : report_{report} {}
    const kinds_report* operator->() const { return report_; }
    const kinds_report& operator*() const { return *report_; }

    /// False for a frame that told nothing: probabilities are then no answer to it.
    bool is_classified() const { return report_->status == kinds_report_CLASSIFIED; }
    /// Probability of each kind, of the frame by itself.
    Numbers<const double> probabilities() const { return {report_->probabilities, report_->n_kinds}; }
    /// Probability of each kind given all frames of the run so far.
    Numbers<const double> filtered() const { return {report_->filtered, report_->n_kinds}; }
    /// Place of the frame in the embedding.
    Numbers<const double> coordinates() const { return {report_->coordinates, report_->n_dims}; }
    /// Number of each kind: its own for ever, while indices are those of one model.
    Numbers<const std::uint32_t> numbers() const { return {report_->numbers, report_->n_kinds}; }
    /// The kinds with those most alike taken together until so many are left; at least 1, and at most all.
    Level at_level(std::uint32_t n_kinds) const { return {report_, n_kinds}; }

private:
    const kinds_report* report_;
};

/// A reader of a sensor's kinds. A range-for over it waits for each report, and goes on for ever.
class Kinds {
public:
    /// Opens them, whether or not a service is there. Without a domain: KINDS_DOMAIN, or else the default one.
    explicit Kinds(const std::string& sensor, const std::string& domain = {}, Waiting waiting = Waiting::by_event)
        : reports_{detail::checked(kinds_reports_open(
              sensor.c_str(), detail::folder(domain), static_cast<std::uint32_t>(waiting)))} {}

    /// The oldest report that waits, or the next until the timeout; none when there is none, or a signal came first. Valid until
    /// the next call.
    std::optional<Report> next(std::chrono::milliseconds timeout) {
        const kinds_report* report = nullptr;
        if (take(timeout, report) != KINDS_RECEIVED) return std::nullopt;
        return Report{report};
    }

    /// Gives the report back before the next one is asked for.
    void release() { detail::checked(kinds_reports_release(reports_.get())); }

    /// Whether a service is there.
    bool is_served() { return detail::checked(kinds_reports_is_served(reports_.get())) == 1; }

    /// What a range of reports never comes to.
    struct End {};
    /// A place in the range of reports.
    class Iterator {
    public:
        explicit Iterator(Kinds& kinds) : kinds_{kinds} { ++*this; }
        Report operator*() const { return Report{report_}; }
        Iterator& operator++() {
            while (kinds_.take(std::chrono::seconds{1}, report_) != KINDS_RECEIVED) {}
            return *this;
        }
        bool operator!=(End) const { return true; }

    private:
        Kinds& kinds_;
        const kinds_report* report_ = nullptr;
    };
    Iterator begin() { return Iterator{*this}; }
    End end() { return {}; }

private:
    int take(std::chrono::milliseconds timeout, const kinds_report*& report) {
        return detail::checked(kinds_reports_next(reports_.get(), detail::ms(timeout), &report));
    }

    detail::Owned<kinds_reports> reports_;
};

/// A frame where the driver shim wrote it; given back when this goes.
class Frame {
public:
    Frame(Frame&& other) noexcept : frames_{std::exchange(other.frames_, nullptr)}, frame_{other.frame_} {}
    Frame& operator=(Frame&& other) noexcept {
        std::swap(frames_, other.frames_);
        std::swap(frame_, other.frame_);
        return *this;
    }
    ~Frame() {
        if (frames_ != nullptr) kinds_frames_release(frames_, &frame_);
    }

    const kinds_frame_header& header() const { return *frame_.header; }
    /// Row by row; 0 for a reading without measurement.
    Numbers<const std::uint16_t> counts() const { return {frame_.counts, frame_.n_readings}; }

private:
    friend class Frames;
    Frame(kinds_frames* frames, kinds_frame frame) : frames_{frames}, frame_{frame} {}

    kinds_frames* frames_;
    kinds_frame frame_;
};

/// A reader of a sensor's frames.
class Frames {
public:
    /// Opens them, whether or not a driver shim is there.
    explicit Frames(const std::string& sensor, const std::string& domain = {}, Waiting waiting = Waiting::by_event)
        : frames_{detail::checked(kinds_frames_open(
              sensor.c_str(), detail::folder(domain), static_cast<std::uint32_t>(waiting)))} {}

    /// The oldest frame that waits, or the next until the timeout; none when there is none, or a signal came first. Two can be
    /// held at a time.
    std::optional<Frame> next(std::chrono::milliseconds timeout) {
        kinds_frame frame;
        const int came = detail::checked(kinds_frames_next(frames_.get(), detail::ms(timeout), &frame));
        if (came != KINDS_RECEIVED) return std::nullopt;
        return Frame{frames_.get(), frame};
    }

private:
    detail::Owned<kinds_frames> frames_;
};

/// A frame that is being filled; given back unsent when this goes.
class Loan {
public:
    Loan(Loan&& other) noexcept : publisher_{std::exchange(other.publisher_, nullptr)}, loan_{other.loan_} {}
    Loan& operator=(Loan&&) = delete;
    ~Loan() {
        if (publisher_ != nullptr) kinds_publisher_give_back(publisher_, &loan_);
    }

    /// What goes with the frame: its number, time, pose and command may be set.
    kinds_frame_header& header() { return loan_.header; }
    /// Row by row, where readers will read them; all 0 (no measurement) as lent.
    Numbers<std::uint16_t> counts() const { return {loan_.counts, loan_.n_readings}; }

    void set_pose(kinds_pose pose) {
        loan_.header.pose = pose;
        loan_.header.flags |= kinds_frame_header_HAS_POSE;
    }
    void set_command(kinds_command command) {
        loan_.header.command = command;
        loan_.header.flags |= kinds_frame_header_HAS_COMMAND;
    }

    /// Sends it, once; waits for no reader.
    void send() && { detail::checked(kinds_publisher_send(std::exchange(publisher_, nullptr), &loan_)); }

private:
    friend class FramePublisher;
    Loan(kinds_publisher* publisher, kinds_loan loan) : publisher_{publisher}, loan_{loan} {}

    kinds_publisher* publisher_;
    kinds_loan loan_;
};

/// What a sensor is.
struct Layout {
    std::uint32_t rows; ///< 1 for a ring
    std::uint32_t columns;
    double metres_per_count;
};

/// The publisher of a sensor's frames: the only one at a time.
class FramePublisher {
public:
    FramePublisher(const std::string& sensor, const Layout& layout, const std::string& domain = {})
        : publisher_{detail::checked(kinds_publisher_open(
              sensor.c_str(), detail::folder(domain), layout.rows, layout.columns, layout.metres_per_count))} {}

    /// Borrows the memory of the next frame. One at a time.
    Loan borrow() {
        kinds_loan loan;
        detail::checked(kinds_publisher_borrow(publisher_.get(), &loan));
        return Loan{publisher_.get(), loan};
    }

    /// Lets readers that came since the last frame connect: some twenty times a second while no frames are sent.
    void update() { detail::checked(kinds_publisher_update(publisher_.get())); }

    /// How many programs read the frames.
    int n_readers() { return detail::checked(kinds_publisher_n_readers(publisher_.get())); }

private:
    detail::Owned<kinds_publisher> publisher_;
};

} // namespace natural_kinds

#endif // NATURAL_KINDS_HPP
