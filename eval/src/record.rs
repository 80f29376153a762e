//! A lockstep run as a bag: the same frames and parameters give the same bytes.

use modulo_bags::bag::BagTopic;
use modulo_bags::record::Recorder;
use modulo_runtime::Topic;
use modulo_runtime::driver::lockstep::OnTopic;

use crate::EvalError;

/// Writes what came out on `topics`; both times are the message's own stamp.
pub(crate) fn record(recorder: &mut Recorder, out: &[OnTopic], topics: &[String]) -> Result<(), EvalError> {
    for (topic, message) in out.iter().filter(|(topic, _)| topics.contains(topic)) {
        let bytes = message.encode()?;
        let stamp = message.stamp().as_ns();
        let kind = message.kind();
        let bag_topic = BagTopic::new(topic, kind.type_name(), Topic::new(topic, kind).qos);
        recorder.record(&bag_topic, stamp, stamp, &bytes)?;
    }
    Ok(())
}
