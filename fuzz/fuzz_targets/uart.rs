//! The Pi's reading of the STM's log, as a UART delivers it: any bytes, in pieces of any size. The
//! pieces make no difference, no line is read twice, and no number is beyond what the STM says.
#![no_main]

use host_link::log::{LogLine, LogParser};
use libfuzzer_sys::fuzz_target;
use pilot::tune::samples::SampleRecorder;
use robot_fuzz::Bytes;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let size = usize::from(bytes.byte()) + 1;
    let log = bytes.rest();
    let mut whole = LogParser::default();
    let lines = whole.feed(log);
    let mut parts = LogParser::default();
    let pieced: Vec<_> = log.chunks(size).flat_map(|part| parts.feed(part)).collect();
    assert!(lines == pieced, "pieces of {size} bytes read otherwise");
    assert!(lines.len() < log.split(|&byte| byte == b'\n').count());

    let mut samples = 0;
    for (number, line) in lines {
        assert!(number < 100_000);
        match line {
            LogLine::Sample { percent, value } => {
                samples += 1;
                assert!(percent.abs() <= 100.0 && value.is_finite());
            }
            LogLine::Tuned { tap, .. } => assert!((1..=8).contains(&tap)),
            LogLine::Link(link) => {
                let sum = link
                    .accepted
                    .saturating_add(link.rejected)
                    .saturating_add(link.lost);
                assert_eq!(link.frames, sum);
                assert_eq!(link.rejected, link.causes.total());
                assert!(link.recent_gap_us <= link.worst_gap_us);
            }
            LogLine::Rangefinder { .. } | LogLine::Other => {}
        }
    }
    let mut recorder = SampleRecorder::default();
    recorder.feed(log);
    let recorded = recorder.samples();
    assert_eq!(recorded.len(), samples);
    assert!(recorded.windows(2).all(|pair| pair[0].tick <= pair[1].tick));
});
