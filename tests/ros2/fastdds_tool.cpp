// Reads or writes raw CDR of any DDS topic with Fast DDS.
// fastdds_tool read DOMAIN TOPIC TYPE SECONDS: prints one line of hexadecimal digits per sample.
// fastdds_tool write DOMAIN TOPIC TYPE SECONDS HZ HEX: writes one payload at a rate.
#include <chrono>
#include <cstdio>
#include <cstring>
#include <string>
#include <thread>
#include <vector>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using Bytes = std::vector<unsigned char>;

class Raw : public TopicDataType {
public:
    explicit Raw(const char *name) { setName(name); m_typeSize = 65536; m_isGetKeyDefined = false; }
    bool serialize(void *data, SerializedPayload_t *payload) override {
        auto &bytes = *static_cast<Bytes *>(data);
        payload->length = bytes.size();
        payload->encapsulation = CDR_LE;
        std::memcpy(payload->data, bytes.data(), bytes.size());
        return true;
    }
    bool deserialize(SerializedPayload_t *payload, void *data) override {
        static_cast<Bytes *>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void *data) override {
        return [data] { return uint32_t(static_cast<Bytes *>(data)->size()); };
    }
    void *createData() override { return new Bytes; }
    void deleteData(void *data) override { delete static_cast<Bytes *>(data); }
    bool getKey(void *, InstanceHandle_t *, bool) override { return false; }
};

int main(int argc, char **argv) {
    if (argc < 6) return 2;
    auto *participant = DomainParticipantFactory::get_instance()->create_participant(std::stoi(argv[2]), PARTICIPANT_QOS_DEFAULT);
    TypeSupport type(new Raw(argv[4]));
    type.register_type(participant);
    auto *topic = participant->create_topic(argv[3], argv[4], TOPIC_QOS_DEFAULT);
    auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(int(1000 * std::stod(argv[5])));
    if (!std::strcmp(argv[1], "read")) {
        auto *subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
        DataReaderQos qos = DATAREADER_QOS_DEFAULT;
        qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
        qos.history().depth = 1000;
        if (argc > 6) { qos.reliability().kind = BEST_EFFORT_RELIABILITY_QOS; qos.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS; }
        auto *reader = subscriber->create_datareader(topic, qos);
        Bytes bytes;
        SampleInfo info;
        std::printf("reading\n");
        std::fflush(stdout);
        while (std::chrono::steady_clock::now() < end) {
            while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
                if (!info.valid_data) continue;
                for (auto b : bytes) std::printf("%02x", b);
                std::printf("\n");
                std::fflush(stdout);
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(2));
        }
    } else {
        Bytes bytes;
        for (const char *c = argv[7]; c[0] && c[1]; c += 2) bytes.push_back(std::stoi(std::string(c, 2), nullptr, 16));
        auto *publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
        auto *writer = publisher->create_datawriter(topic, DATAWRITER_QOS_DEFAULT);
        while (std::chrono::steady_clock::now() < end) {
            writer->write(&bytes);
            std::this_thread::sleep_for(std::chrono::microseconds(int(1e6 / std::stod(argv[6]))));
        }
    }
    std::fflush(stdout);
    std::_Exit(0);
}
