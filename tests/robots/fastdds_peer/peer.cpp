// A robot that is not ours: Fast DDS, type support generated from PoseStamped.idl. Prints the first goal on rt/goal_pose as
// one line "frame sec nanosec x y z qx qy qz qw" and leaves.  usage: peer DOMAIN SECONDS
#include "PoseStampedPubSubTypes.h"
#include <chrono>
#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <iomanip>
#include <iostream>
#include <thread>

using namespace eprosima::fastdds::dds;

int main(int, char** argv) {
  DomainParticipantQos qos;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(udp);
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(std::atoi(argv[1]), qos);
  TypeSupport type(new geometry_msgs::msg::dds_::PoseStamped_PubSubType());
  type.register_type(participant);
  Topic* topic = participant->create_topic("rt/goal_pose", type.get_type_name(), TOPIC_QOS_DEFAULT);
  DataReaderQos reliable = DATAREADER_QOS_DEFAULT;
  reliable.reliability().kind = RELIABLE_RELIABILITY_QOS;
  DataReader* reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, reliable);
  std::cout << "ready" << std::endl;
  for (int i = 0; i < std::atoi(argv[2]) * 100; ++i) {
    geometry_msgs::msg::dds_::PoseStamped_ goal;
    SampleInfo info;
    while (reader->take_next_sample(&goal, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) {
        auto& p = goal.pose().position();
        auto& q = goal.pose().orientation();
        std::cout << std::setprecision(17) << goal.header().frame_id() << ' ' << goal.header().stamp().sec() << ' '
                  << goal.header().stamp().nanosec() << ' ' << p.x() << ' ' << p.y() << ' ' << p.z() << ' ' << q.x() << ' '
                  << q.y() << ' ' << q.z() << ' ' << q.w() << std::endl;
        std::this_thread::sleep_for(std::chrono::milliseconds(300));  // the receipt must still go out
        std::_Exit(0);
      }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  std::_Exit(1);
}
