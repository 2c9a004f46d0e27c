//! The log, and frames for some time.

use super::*;

#[test]
fn log_is_read_until_it_fails() {
    let (board, mut io) = mock_board(&image(2), None);
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    let log = "I00013: L 40 40 0 - 25013 25013 -\nI00014: L 80 80 0 - 25013 25013 -\n";
    for part in log.as_bytes().chunks(20) {
        board.borrow_mut().log.extend(part);
        assert_eq!(session.poll_log(), part);
    }
    assert_eq!(session.snapshot().stm.map(|stm| stm.frames), Some(80));
    let working = std::mem::replace(&mut session.io.log, Box::new(|_| Err(Error::Interrupted)));
    assert!(session.poll_log().is_empty());
    session.io.log = working;
    board.borrow_mut().log.push(b'x');
    assert!(session.poll_log().is_empty());
    assert_eq!(session.log_error(), Some("interrupted"));
    assert_eq!(session.read_log(), Ok(b"x".to_vec()));
}

#[test]
fn observation_ends_with_its_time_or_an_error() {
    let (board, mut io) = mock_board(&image(2), None);
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    session.io.log = Box::new(|_| Ok(b"x".to_vec()));
    board.borrow_mut().garbled_from = 20;
    // The first frame takes 1 µs.
    for (us, counts) in [(1, (1, 0, 2)), (500_000, (21, 1, 21))] {
        let (seen, logged, ended) = session.observe(us).unwrap();
        let link = (seen.link.frames, seen.link.rejected, logged);
        assert_eq!((link, ended), (counts, None));
    }
    board.borrow_mut().fault = Some(IoFault::BusesFail(0));
    let (seen, _, ended) = session.observe(500_000).unwrap();
    assert!(seen.link.frames == 21 && matches!(ended, Some(Error::Spi(_))));
    session.io().interrupt.raise();
    assert_eq!(session.observe(500_000), Err(Error::Interrupted));
}

#[test]
fn round_trip_is_right_after_failed_transfers() {
    let (board, mut io) = mock_board(&image_in(Mode::GuardedNormal), None);
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    for fault in [None, Some(IoFault::BusesFail(0)), None] {
        board.borrow_mut().fault = fault;
        (0..5).for_each(|_| drop(session.exchange(&CommandRequest::default())));
    }
    assert_eq!(session.statistics().round_trip_us, Some(25_001));
}

#[test]
fn restart_ends_what_the_log_called_silent() {
    let (_, mut io) = mock_board(&image(2), None);
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    session.snapshot.silent = [true; 3];
    session.link.restarted = true;
    session.take_over(0, &Report::default());
    assert_eq!(session.snapshot().silent, [false; 3]);
}
