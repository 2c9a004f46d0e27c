//! Accesses of a run that the models do not cover.

use rigless::session::Session;

use crate::virtual_board::VirtualBoard;

/// Every register access without a model and every objection of a model, one line each. The run of
/// a correct firmware has none.
pub fn unmodelled(session: &Session<VirtualBoard>) -> Vec<String> {
    let unmapped = session.unmapped().into_iter().map(|access| {
        let (at, from) = (access.address, access.program_counter);
        format!("nothing at {at:#010x}, first from {from:#010x}")
    });
    let refused = session.refused().iter();
    let refused = refused.map(|(at, fault)| format!("refused at {at:#010x}: {fault}"));
    let unimplemented = session.unimplemented().iter().map(|(at, access)| {
        format!(
            "no model of {} {} at {at:#010x}: {} reads, {} writes, first from {:#010x}",
            access.instance, access.register, access.reads, access.writes, access.program_counter
        )
    });
    let undefined = session.undefined().iter().map(|(at, access)| {
        let (instance, from) = (access.instance, access.program_counter);
        format!("no register of {instance} at {at:#010x}, first from {from:#010x}")
    });
    let unrouted = session
        .unrouted()
        .iter()
        .map(|(instance, number)| format!("interrupt {number} of {instance} reaches no line"));
    let objections = session.told().map(|objection| {
        format!(
            "{} {}: {} (first at {} ns)",
            objection.instance, objection.register, objection.reason, objection.at.0
        )
    });
    let accesses = unmapped
        .chain(refused)
        .chain(unimplemented)
        .chain(undefined);
    accesses.chain(unrouted).chain(objections).collect()
}
