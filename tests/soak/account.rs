//! What became of every frame: reported once, or not, for a cause that has a name.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;

use crate::witness::{FrameId, Ledger, SeenFrame, SeenReport};

/// Readings of a whole frame.
const N_READINGS: usize = 16;

/// What was done to shim and service, by the monotonic clock.
#[derive(Default)]
pub(crate) struct Happened {
    pub(crate) shim_killed_ns: Vec<u64>,
    pub(crate) service_killed_ns: Vec<u64>,
    /// From when to when it was stopped.
    pub(crate) service_still_ns: Vec<(u64, u64)>,
}

/// Why a frame was not reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Cause {
    WrongLength,
    OutOfOrder,
    ServiceStoodStill,
    Overtaken,
    NoService,
    ShimKilled,
}

impl Cause {
    fn words(self) -> &'static str {
        match self {
            Self::WrongLength => "refused: a wrong length",
            Self::OutOfOrder => "overtaken by a later frame on its way",
            Self::ServiceStoodStill => "the service stood still, and counted it as lost",
            Self::Overtaken => "newer ones came before it was taken, and it was counted as lost",
            Self::NoService => "between a service's last report and its successor's first",
            Self::ShimKilled => "on its way when its shim was killed",
        }
    }
}

/// All frames of a soak by what became of them.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Account {
    n_frames: usize,
    n_reports: usize,
    causes: BTreeMap<Cause, usize>,
    unexplained: Vec<SeenFrame>,
    reported_twice: Vec<FrameId>,
    /// Reports whose number of lost frames is not that of the gap before them.
    miscounted: Vec<SeenReport>,
}

impl Account {
    pub(crate) fn of(ledger: &Ledger, happened: &Happened) -> Self {
        let reported: HashSet<FrameId> = ledger.reports.iter().map(|report| report.id).collect();
        let seen: HashSet<FrameId> = ledger.frames.iter().map(|frame| frame.id).collect();
        let mut account = Self {
            n_frames: seen.union(&reported).count(),
            n_reports: ledger.reports.len(),
            reported_twice: ledger.reported_twice(),
            miscounted: miscounted(&ledger.reports, happened),
            ..Self::default()
        };
        let causes = Causes::new(ledger, happened);
        let mut n_seen_of_run: HashMap<u64, u64> = HashMap::new();
        let mut known: HashSet<FrameId> = HashSet::new();
        for frame in &ledger.frames {
            let (run, sequence) = frame.id;
            let next = n_seen_of_run.entry(run).or_default();
            let out_of_order = sequence < *next;
            *next = (*next).max(sequence + 1);
            if !known.insert(frame.id) || reported.contains(&frame.id) {
                continue;
            }
            match causes.of(frame, out_of_order) {
                Some(cause) => *account.causes.entry(cause).or_default() += 1,
                None => account.unexplained.push(*frame),
            }
        }
        account
    }

    /// Asserts that there is nothing that should not be.
    pub(crate) fn check(&self) {
        assert_eq!(self.unexplained, [], "frames that nobody accounts for");
        assert_eq!(self.reported_twice, []);
        assert_eq!(self.miscounted, [], "gaps that are not counted as they are");
        assert!(self.n_reports > 0);
    }
}

impl fmt::Display for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "  frames                          {}", self.n_frames)?;
        write!(f, "\n  reports                         {}", self.n_reports)?;
        for (cause, n_frames) in &self.causes {
            write!(f, "\n  not reported                    {n_frames}: {}", cause.words())?;
        }
        write!(f, "\n  unexplained                     {}", self.unexplained.len())
    }
}

/// What the causes are told by.
struct Causes<'a> {
    happened: &'a Happened,
    /// Of each run, the numbers that its reports count as lost: first, and the one after the last.
    gaps: HashMap<u64, Vec<(u64, u64)>>,
    /// When the frames of a service's last report and of its successor's first were sent.
    without_service_ns: Vec<(u64, u64)>,
    /// Of each run, the last number that was reported, and when the next run began.
    ends: HashMap<u64, (Option<u64>, u64)>,
}

impl<'a> Causes<'a> {
    fn new(ledger: &Ledger, happened: &'a Happened) -> Self {
        let mut gaps: HashMap<u64, Vec<(u64, u64)>> = HashMap::new();
        for report in &ledger.reports {
            let (run, sequence) = report.id;
            gaps.entry(run).or_default().push((sequence.saturating_sub(report.n_lost), sequence));
        }
        let without_service_ns = happened
            .service_killed_ns
            .iter()
            .map(|&killed_ns| {
                let first_after = ledger.reports.partition_point(|report| report.reported_ns < killed_ns);
                let sent_ns = |index: usize| ledger.reports.get(index).map(|report| report.sent_ns);
                let last_ns = first_after.checked_sub(1).and_then(sent_ns).unwrap_or(0);
                (last_ns, sent_ns(first_after).unwrap_or(u64::MAX))
            })
            .collect();
        Self { happened, gaps, without_service_ns, ends: ends(ledger) }
    }

    fn of(&self, frame: &SeenFrame, out_of_order: bool) -> Option<Cause> {
        let (run, sequence) = frame.id;
        let sent_ns = frame.sent_ns;
        let among = |spans: &[(u64, u64)], at| spans.iter().any(|&(from, to)| from <= at && at < to);
        if frame.n_readings != N_READINGS {
            return Some(Cause::WrongLength);
        }
        if out_of_order {
            return Some(Cause::OutOfOrder);
        }
        if self.gaps.get(&run).is_some_and(|gaps| among(gaps, sequence)) {
            let stood_still = among(&self.happened.service_still_ns, sent_ns);
            return Some(if stood_still { Cause::ServiceStoodStill } else { Cause::Overtaken });
        }
        if among(&self.without_service_ns, sent_ns) {
            return Some(Cause::NoService);
        }
        let &(last, next_run_ns) = self.ends.get(&run)?;
        let is_tail = last.is_none_or(|last| sequence > last);
        let was_killed = self.happened.shim_killed_ns.iter().any(|&at| sent_ns < at && at < next_run_ns);
        (is_tail && was_killed).then_some(Cause::ShimKilled)
    }
}

fn ends(ledger: &Ledger) -> HashMap<u64, (Option<u64>, u64)> {
    let mut ends = HashMap::new();
    // As they were sent: of shims that follow each other quickly, the later one's frames may be seen first.
    let mut frames = ledger.frames.clone();
    frames.sort_by_key(|frame| frame.sent_ns);
    for runs in frames.chunk_by(|a, b| a.id.0 == b.id.0) {
        ends.insert(runs[0].id.0, (None, u64::MAX));
    }
    for pair in frames.windows(2).filter(|pair| pair[0].id.0 != pair[1].id.0) {
        ends.insert(pair[0].id.0, (None, pair[1].sent_ns));
    }
    for report in &ledger.reports {
        let (run, sequence) = report.id;
        let (last, _) = ends.entry(run).or_insert((None, u64::MAX));
        *last = (*last).max(Some(sequence));
    }
    ends
}

/// Reports of one service on one run follow each other with the gaps that they tell.
fn miscounted(reports: &[SeenReport], happened: &Happened) -> Vec<SeenReport> {
    let by_one_service = |pair: &&[SeenReport]| {
        let between = pair[0].reported_ns..pair[1].reported_ns;
        !happened.service_killed_ns.iter().any(|at| between.contains(at))
    };
    let is_wrong = |pair: &&[SeenReport]| {
        let [(run, sequence), (next_run, next)] = [pair[0].id, pair[1].id];
        let n_lost = if run == next_run { next.saturating_sub(sequence + 1) } else { next };
        n_lost != pair[1].n_lost
    };
    reports.windows(2).filter(by_one_service).filter(is_wrong).map(|pair| pair[1]).collect()
}

fn frame(run: u64, sequence: u64) -> SeenFrame {
    SeenFrame { id: (run, sequence), n_readings: N_READINGS, sent_ns: 1000 * run + 10 * sequence }
}

fn report(run: u64, sequence: u64, n_lost: u64) -> SeenReport {
    let sent_ns = frame(run, sequence).sent_ns;
    SeenReport { id: (run, sequence), n_lost, sent_ns, reported_ns: sent_ns + 1 }
}

fn check(frames: Vec<SeenFrame>, reports: Vec<SeenReport>, happened: &Happened, expected: &[Option<Cause>]) {
    let account = Account::of(&Ledger { frames, reports }, happened);
    let mut causes = BTreeMap::new();
    expected.iter().flatten().for_each(|cause| *causes.entry(*cause).or_default() += 1);
    let n_unexplained = expected.iter().filter(|cause| cause.is_none()).count();
    assert_eq!((&account.causes, account.unexplained.len()), (&causes, n_unexplained), "{account:?}");
    assert!(account.miscounted.is_empty() && account.reported_twice.is_empty(), "{account:?}");
}

#[test]
fn a_frame_that_nobody_accounts_for_is_unexplained() {
    let frames = |n_frames| (0..n_frames).map(|sequence| frame(1, sequence)).collect();
    let all_is_well = Happened::default();
    check(frames(2), vec![report(1, 0, 0), report(1, 1, 0)], &all_is_well, &[]);
    check(frames(3), vec![report(1, 0, 0), report(1, 1, 0)], &all_is_well, &[None]);
    check(frames(3), vec![report(1, 1, 1)], &all_is_well, &[Some(Cause::Overtaken), None]);
    let still = Happened { service_still_ns: vec![(1005, 1015)], ..Happened::default() };
    check(frames(3), vec![report(1, 0, 0), report(1, 2, 1)], &still, &[Some(Cause::ServiceStoodStill)]);
}

#[test]
fn killed_services_and_shims_account_for_what_was_sent_about_then_and_for_no_more() {
    let frames: Vec<_> = (0..6).map(|sequence| frame(1, sequence)).chain([frame(2, 0)]).collect();
    let service = Happened { service_killed_ns: vec![1025], ..Happened::default() };
    let reports = vec![report(1, 0, 0), report(1, 1, 0), report(1, 4, 0), report(2, 0, 0)];
    let no_service = Some(Cause::NoService);
    check(frames.clone(), reports.clone(), &service, &[no_service, no_service, None]);
    let both = Happened { shim_killed_ns: vec![1060], ..service };
    check(frames, reports, &both, &[no_service, no_service, Some(Cause::ShimKilled)]);
    // Of two that were killed while they started, the later one's frame was seen first.
    let starting = Happened { shim_killed_ns: vec![2500, 3500], ..Happened::default() };
    let crossed = vec![frame(1, 0), frame(3, 0), frame(2, 0), frame(4, 0)];
    check(crossed, vec![report(1, 0, 0), report(4, 0, 0)], &starting, &[Some(Cause::ShimKilled); 2]);
}

#[test]
fn a_gap_that_a_report_does_not_tell_and_a_second_report_are_found() {
    let ledger = Ledger {
        frames: (0..3).map(|sequence| frame(1, sequence)).collect(),
        reports: vec![report(1, 0, 0), report(1, 2, 0), report(1, 2, 0)],
    };
    let account = Account::of(&ledger, &Happened::default());
    assert_eq!(account.miscounted, [report(1, 2, 0)]);
    assert_eq!(account.reported_twice, [(1, 2)]);
    assert_eq!(account.unexplained, [frame(1, 1)]);
}
